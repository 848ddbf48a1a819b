//! A surface as binary glTF 2.0: positions, normals and a colour per vertex, metres, +y up.
//!
//! Skin and cut faces do not share vertices, nor do faces that meet at more than 50 degrees: each such
//! group round a vertex gets a copy of it with a normal of its own. So the lips of a cut are crisp, and
//! its two sides are shaded apart where they meet at the front.

use std::path::Path;

use serde_json::json;

use crate::surface::{Face, Surface, Triangle};

/// Cosine of the angle between two faces above which their normals are not blended: 50 degrees.
const CREASE_ANGLE_COS: f32 = 0.643;
/// Linear RGBA of the outer surface.
const SKIN_COLOUR: [u8; 4] = [128, 22, 16, 255];
/// Linear RGBA of what a blade laid open.
const CUT_COLOUR: [u8; 4] = [205, 92, 74, 255];

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Writes a mesh as a `.glb` file.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, surface: &Surface) -> std::io::Result<()> {
    std::fs::write(path, encode(surface))
}

/// A mesh as the bytes of a `.glb` file. One without triangles becomes an empty scene.
#[must_use]
pub fn encode(surface: &Surface) -> Vec<u8> {
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "Kerf" },
        "scene": 0,
        "scenes": [{}],
    });
    let mut binary = Vec::new();
    if !surface.triangles.is_empty() {
        describe(&shaded(surface), &mut document, &mut binary);
    }
    container(&document, binary)
}

/// Vertices ready for a renderer: as many normals and colours as positions.
#[derive(Default)]
struct Shaded {
    positions_m: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    colours: Vec<[u8; 4]>,
    indices: Vec<u32>,
}

/// Gives every smooth group of triangles round a vertex a copy of it.
fn shaded(surface: &Surface) -> Shaded {
    let area_normals: Vec<[f32; 3]> = surface.triangles.iter().map(|t| area_normal(surface, t)).collect();
    let mut corners_at = vec![Vec::new(); surface.positions_m.len()];
    for (corner, vertex) in surface.triangles.iter().flat_map(|t| t.vertices).enumerate() {
        corners_at[vertex as usize].push(corner);
    }
    let mut shaded = Shaded { indices: vec![0; surface.triangles.len() * 3], ..Shaded::default() };
    for (vertex, mut corners) in corners_at.into_iter().enumerate() {
        while let Some(first) = corners.pop() {
            let group = smooth_group(surface, &area_normals, first, &mut corners);
            let index = shaded.positions_m.len() as u32;
            group.iter().for_each(|corner| shaded.indices[*corner] = index);
            let sum = group.iter().fold([0.0; 3], |sum, corner| add(sum, area_normals[corner / 3]));
            shaded.positions_m.push(surface.positions_m[vertex]);
            shaded.normals.push(unit(sum).unwrap_or([0.0, 1.0, 0.0]));
            shaded.colours.push(match surface.triangles[first / 3].face {
                Face::Skin => SKIN_COLOUR,
                Face::Cut => CUT_COLOUR,
            });
        }
    }
    shaded
}

/// Takes out of `corners` those that `first` is joined to by a chain of faces of one kind, each
/// within the crease angle of another, and returns them with it.
fn smooth_group(surface: &Surface, area_normals: &[[f32; 3]], first: usize, corners: &mut Vec<usize>) -> Vec<usize> {
    let smooth = |a: usize, b: usize| {
        let (Some(normal_a), Some(normal_b)) = (unit(area_normals[a / 3]), unit(area_normals[b / 3])) else {
            return true; // A triangle without area has no direction to differ in.
        };
        surface.triangles[a / 3].face == surface.triangles[b / 3].face && dot(normal_a, normal_b) >= CREASE_ANGLE_COS
    };
    let mut group = vec![first];
    let mut next = 0;
    while next < group.len() {
        let member = group[next];
        group.extend(corners.extract_if(.., |corner| smooth(member, *corner)));
        next += 1;
    }
    group
}

/// Normal of a triangle with twice its area as length.
fn area_normal(surface: &Surface, triangle: &Triangle) -> [f32; 3] {
    let [a, b, c] = triangle.vertices.map(|v| surface.positions_m[v as usize]);
    let (u, v) = (subtract(b, a), subtract(c, a));
    std::array::from_fn(|i| u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3])
}

fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

fn subtract(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

fn unit(a: [f32; 3]) -> Option<[f32; 3]> {
    let length = dot(a, a).sqrt();
    (length > 0.0).then(|| a.map(|c| c / length))
}

/// Adds one mesh to the document, its data to the binary chunk.
fn describe(shaded: &Shaded, document: &mut serde_json::Value, binary: &mut Vec<u8>) {
    let mut views = Vec::new();
    let mut view = |bytes: &[u8], target: u32| {
        views.push(json!({
            "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "target": target,
        }));
        binary.extend_from_slice(bytes);
    };
    view(&floats(&shaded.positions_m), ARRAY_BUFFER);
    view(&floats(&shaded.normals), ARRAY_BUFFER);
    view(shaded.colours.as_flattened(), ARRAY_BUFFER);
    view(&shaded.indices.iter().flat_map(|i| i.to_le_bytes()).collect::<Vec<u8>>(), ELEMENT_ARRAY_BUFFER);

    let vertices = shaded.positions_m.len();
    let bound = |pick: fn(f32, f32) -> f32| {
        shaded.positions_m.iter().copied().reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
    };
    document["buffers"] = json!([{ "byteLength": binary.len() }]);
    document["bufferViews"] = json!(views);
    document["accessors"] = json!([
        { "bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3",
          "min": bound(f32::min), "max": bound(f32::max) },
        { "bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3" },
        { "bufferView": 2, "componentType": UNSIGNED_BYTE, "normalized": true, "count": vertices, "type": "VEC4" },
        { "bufferView": 3, "componentType": UNSIGNED_INT, "count": shaded.indices.len(), "type": "SCALAR" },
    ]);
    document["materials"] = json!([{
        "name": "tissue",
        "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.55 },
    }]);
    document["meshes"] = json!([{ "primitives": [{
        "attributes": { "POSITION": 0, "NORMAL": 1, "COLOR_0": 2 }, "indices": 3, "material": 0,
    }] }]);
    document["nodes"] = json!([{ "mesh": 0 }]);
    document["scenes"] = json!([{ "nodes": [0] }]);
}

fn floats(values: &[[f32; 3]]) -> Vec<u8> {
    values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// The header and the chunks, each padded to four bytes.
fn container(document: &serde_json::Value, mut binary: Vec<u8>) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut chunks = vec![(*b"JSON", text)];
    if !binary.is_empty() {
        chunks.push((*b"BIN\0", binary));
    }
    let length: usize = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
    let mut glb = Vec::with_capacity(length);
    glb.extend(b"glTF");
    glb.extend(2u32.to_le_bytes());
    glb.extend((length as u32).to_le_bytes());
    for (kind, data) in chunks {
        glb.extend((data.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(data);
    }
    glb
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The JSON and binary chunks, after checking the framing.
    fn parse(glb: &[u8]) -> (serde_json::Value, Vec<u8>) {
        let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&glb[..4], word(4), word(8)), (b"glTF".as_slice(), 2, glb.len()));
        let mut at = 12;
        let mut chunk = |kind: &[u8; 4]| {
            if at == glb.len() {
                return Vec::new();
            }
            let length = word(at);
            assert_eq!((length % 4, &glb[at + 4..at + 8]), (0, kind.as_slice()));
            at += 8 + length;
            glb[at - length..at].to_vec()
        };
        let document = serde_json::from_slice(&chunk(b"JSON")).unwrap();
        let binary = chunk(b"BIN\0");
        assert_eq!(at, glb.len());
        (document, binary)
    }

    /// Bytes of an accessor's view, after checking that it fits.
    fn view<'a>(document: &serde_json::Value, binary: &'a [u8], accessor: usize, stride: usize) -> &'a [u8] {
        let number = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
        let accessor = &document["accessors"][accessor];
        let view = &document["bufferViews"][number(&accessor["bufferView"])];
        let (offset, length) = (number(&view["byteOffset"]), number(&view["byteLength"]));
        assert_eq!((offset % 4, length), (0, number(&accessor["count"]) * stride));
        assert!(offset + length <= number(&document["buffers"][0]["byteLength"]) && offset + length <= binary.len());
        &binary[offset..offset + length]
    }

    fn vectors(bytes: &[u8]) -> Vec<[f32; 3]> {
        let floats: Vec<f32> = bytes.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        floats.as_chunks::<3>().0.to_vec()
    }

    /// A roof of two squares that meet at this angle along x = 0; the right one is laid open by a cut
    /// or is skin too.
    fn roof(angle_degrees: f32, right: Face) -> Surface {
        let (sin, cos) = angle_degrees.to_radians().sin_cos();
        let x = |x: f32, z: f32| if x > 0.0 { [cos, -sin, z] } else { [x, 0.0, z] };
        let positions_m = vec![x(-1.0, 0.0), x(-1.0, 1.0), x(0.0, 1.0), x(0.0, 0.0), x(1.0, 1.0), x(1.0, 0.0)];
        let triangle = |vertices, face| Triangle { vertices, face };
        let triangles = vec![
            triangle([0, 1, 2], Face::Skin),
            triangle([0, 2, 3], Face::Skin),
            triangle([3, 2, 4], right),
            triangle([3, 4, 5], right),
        ];
        Surface { positions_m, triangles }
    }

    #[test]
    fn a_mesh_reads_back_with_its_bounds_and_indices_in_range() {
        let surface = roof(30.0, Face::Skin);
        let (document, binary) = parse(&encode(&surface));
        let positions = vectors(view(&document, &binary, 0, 12));
        for (axis, (low, high)) in [(-1.0, 0.75f32.sqrt()), (-0.5, 0.0), (0.0, 1.0)].into_iter().enumerate() {
            let bound = |which: &str| document["accessors"][0][which][axis].as_f64().unwrap() as f32;
            assert!((bound("min") - low).abs() < 1e-6 && (bound("max") - high).abs() < 1e-6, "axis {axis}");
        }
        let indices: Vec<usize> = view(&document, &binary, 3, 4)
            .chunks(4)
            .map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize)
            .collect();
        let expected = surface.triangles.iter().flat_map(|t| t.vertices).map(|v| surface.positions_m[v as usize]);
        assert!(indices.iter().map(|i| positions[*i]).eq(expected));
        for normal in vectors(view(&document, &binary, 1, 12)) {
            assert!((dot(normal, normal) - 1.0).abs() < 1e-5 && normal[1] > 0.8, "{normal:?}");
        }
        assert_eq!(view(&document, &binary, 2, 4).chunks(4).next(), Some(SKIN_COLOUR.as_slice()));
    }

    #[test]
    fn normals_are_blended_over_gentle_edges_of_one_kind_only() {
        for (angle_degrees, right, vertices) in [(30.0, Face::Skin, 6), (80.0, Face::Skin, 8), (0.0, Face::Cut, 8)] {
            let (document, _) = parse(&encode(&roof(angle_degrees, right)));
            assert_eq!(document["accessors"][0]["count"], vertices, "{angle_degrees} {right:?}");
        }
    }

    #[test]
    fn an_empty_mesh_is_an_empty_scene() {
        let (document, binary) = parse(&encode(&Surface::default()));
        assert_eq!((document["asset"]["version"].as_str(), binary.len()), (Some("2.0"), 0));
        assert!(document.get("buffers").is_none() && document.get("meshes").is_none());
    }
}
