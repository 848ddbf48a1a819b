//! Surfaces as binary glTF 2.0, metres, +y up: a node for each object, by its name, and materials for each of its
//! regions, one of its skin and one of what a blade laid open.
//!
//! Skin and cut faces do not share vertices, nor do faces that meet at more than 50 degrees: each such
//! group round a vertex gets a copy of it with a normal of its own. So the lips of a cut are crisp, and
//! its two sides are shaded apart where they meet at the front. Vertices at which skin and cut meet are dark, so that
//! a cut is seen as a seam while it is closed.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use crate::surface::{Face, Surface, Triangle};

/// Cosine of the angle between two faces above which their normals are not blended: 50 degrees.
const CREASE_ANGLE_COS: f32 = 0.643;
/// Linear RGB of the skins of regions that state no colour, in the order in which they come.
const SKIN_COLOURS: [[f32; 3]; 6] = [
    [0.50, 0.09, 0.06],
    [0.72, 0.48, 0.14],
    [0.22, 0.26, 0.52],
    [0.24, 0.42, 0.18],
    [0.44, 0.18, 0.42],
    [0.58, 0.56, 0.50],
];
/// How much of the way to white a cut face is from the skin's colour.
const CUT_PALENESS: f32 = 0.4;
/// What a material's colour is multiplied by at a vertex, and where skin and cut meet.
const PLAIN: [u8; 4] = [255; 4];
const SEAM: [u8; 4] = [40, 40, 40, 255];

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// An object of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// Its name.
    pub name: String,
    /// Names of its regions.
    pub regions: Vec<String>,
    /// Colours that are stated, sRGB: the object's own, then its regions'. What is missing is chosen.
    pub colours: Vec<Option<[u8; 3]>>,
    /// Its surface.
    pub surface: Surface,
}

/// Writes objects as a `.glb` file.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, objects: &[Object]) -> std::io::Result<()> {
    std::fs::write(path, encode(objects))
}

/// Objects as the bytes of a `.glb` file. Those without triangles are left out; without any the scene is empty.
#[must_use]
pub fn encode(objects: &[Object]) -> Vec<u8> {
    let mut document = Document::default();
    for object in objects.iter().filter(|object| !object.surface.triangles.is_empty()) {
        document.add(object);
    }
    document.container()
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
    let is = |face: Face| move |corner: &usize| surface.triangles[corner / 3].face == face;
    let mut shaded = Shaded { indices: vec![0; surface.triangles.len() * 3], ..Shaded::default() };
    for (vertex, mut corners) in corners_at.into_iter().enumerate() {
        let is_seam = corners.iter().any(is(Face::Skin)) && corners.iter().any(is(Face::Cut));
        while let Some(first) = corners.pop() {
            let group = smooth_group(surface, &area_normals, first, &mut corners);
            let index = shaded.positions_m.len() as u32;
            group.iter().for_each(|corner| shaded.indices[*corner] = index);
            let sum = group.iter().fold([0.0; 3], |sum, corner| add(sum, area_normals[corner / 3]));
            shaded.positions_m.push(surface.positions_m[vertex]);
            shaded.normals.push(unit(sum).unwrap_or([0.0, 1.0, 0.0]));
            shaded.colours.push(if is_seam { SEAM } else { PLAIN });
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

/// A colour as the wire has it, "#rrggbb"; none where none is stated.
#[must_use]
pub fn srgb(text: &str) -> Option<[u8; 3]> {
    let value = u32::from_str_radix(text.strip_prefix('#')?, 16).ok()?;
    let [_, srgb @ ..] = value.to_be_bytes();
    Some(srgb)
}

/// A component of a colour in sRGB as glTF has it (IEC 61966-2-1).
fn linear(srgb: u8) -> f32 {
    let c = f32::from(srgb) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// The parts of a document as they come.
#[derive(Default)]
struct Document {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    /// Regions so far, of all objects.
    regions: usize,
}

impl Document {
    /// Adds an object: a node with a mesh, whose parts share their vertices and have a material each.
    fn add(&mut self, object: &Object) {
        let shaded = shaded(&object.surface);
        let bound = |pick: fn(f32, f32) -> f32| {
            shaded.positions_m.iter().copied().reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
        };
        let count = shaded.positions_m.len();
        let positions = json!({ "componentType": FLOAT, "count": count, "type": "VEC3",
                                "min": bound(f32::min), "max": bound(f32::max) });
        let positions = self.accessor(&floats(&shaded.positions_m), ARRAY_BUFFER, positions);
        let normals = json!({ "componentType": FLOAT, "count": count, "type": "VEC3" });
        let normals = self.accessor(&floats(&shaded.normals), ARRAY_BUFFER, normals);
        let colours = json!({ "componentType": UNSIGNED_BYTE, "normalized": true, "count": count, "type": "VEC4" });
        let colours = self.accessor(shaded.colours.as_flattened(), ARRAY_BUFFER, colours);

        let mut parts: BTreeMap<(u16, Face), Vec<u32>> = BTreeMap::new();
        let (triangles, _) = shaded.indices.as_chunks::<3>();
        for (triangle, indices) in object.surface.triangles.iter().zip(triangles) {
            parts.entry((triangle.region, triangle.face)).or_default().extend(indices);
        }
        let primitives: Vec<Value> = parts
            .into_iter()
            .map(|((region, face), indices)| {
                let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
                let described = json!({ "componentType": UNSIGNED_INT, "count": indices.len(), "type": "SCALAR" });
                json!({
                    "attributes": { "POSITION": positions, "NORMAL": normals, "COLOR_0": colours },
                    "indices": self.accessor(&bytes, ELEMENT_ARRAY_BUFFER, described),
                    "material": self.material(object, region, face),
                })
            })
            .collect();
        self.nodes.push(json!({ "mesh": self.meshes.len(), "name": object.name }));
        self.meshes.push(json!({ "name": object.name, "primitives": primitives }));
        self.regions += 1 + object.regions.len();
    }

    /// Adds bytes, and returns the place of what is described by them.
    fn accessor(&mut self, bytes: &[u8], target: u32, mut described: Value) -> usize {
        described["bufferView"] = json!(self.views.len());
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len(), "target": target,
        }));
        self.binary.extend_from_slice(bytes);
        self.accessors.push(described);
        self.accessors.len() - 1
    }

    fn material(&mut self, object: &Object, region: u16, face: Face) -> usize {
        let region = usize::from(region);
        let name = match region.checked_sub(1).and_then(|region| object.regions.get(region)) {
            Some(region) => format!("{}: {region}", object.name),
            None => object.name.clone(),
        };
        let stated = object.colours.get(region).copied().flatten().map(|srgb| srgb.map(linear));
        let skin = stated.unwrap_or(SKIN_COLOURS[(self.regions + region) % SKIN_COLOURS.len()]);
        let (name, [r, g, b]) = match face {
            Face::Skin => (name, skin),
            Face::Cut => (format!("{name}, cut"), skin.map(|c| c + CUT_PALENESS * (1.0 - c))),
        };
        self.materials.push(json!({
            "name": name,
            "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.55 },
        }));
        self.materials.len() - 1
    }

    /// The header and the chunks, each padded to four bytes.
    fn container(mut self) -> Vec<u8> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "Kerf" },
            "scene": 0,
            "scenes": [{}],
        });
        if !self.nodes.is_empty() {
            document["scenes"] = json!([{ "nodes": (0..self.nodes.len()).collect::<Vec<_>>() }]);
            document["buffers"] = json!([{ "byteLength": self.binary.len() }]);
            let lists = [
                ("bufferViews", self.views),
                ("accessors", self.accessors),
                ("materials", self.materials),
                ("meshes", self.meshes),
                ("nodes", self.nodes),
            ];
            lists.into_iter().for_each(|(name, list)| document[name] = Value::Array(list));
        }
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut chunks = vec![(*b"JSON", text)];
        if !self.binary.is_empty() {
            chunks.push((*b"BIN\0", self.binary));
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
}

fn floats(values: &[[f32; 3]]) -> Vec<u8> {
    values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect()
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
        let triangle = |vertices, face| Triangle { vertices, face, region: 0 };
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
        let (document, binary) = parse(&encode(&[Object { surface: surface.clone(), ..Object::default() }]));
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
        assert_eq!(view(&document, &binary, 2, 4).chunks(4).next(), Some(PLAIN.as_slice()));
    }

    #[test]
    fn normals_are_blended_over_gentle_edges_of_one_kind_only() {
        for (angle_degrees, right, vertices) in [(30.0, Face::Skin, 6), (80.0, Face::Skin, 8), (0.0, Face::Cut, 8)] {
            let (document, _) = parse(&encode(&[Object { surface: roof(angle_degrees, right), ..Object::default() }]));
            assert_eq!(document["accessors"][0]["count"], vertices, "{angle_degrees} {right:?}");
        }
    }

    #[test]
    fn objects_are_nodes_and_their_regions_materials() {
        let mut surface = roof(0.0, Face::Cut);
        surface.triangles[1].region = 1;
        let names = [("liver", vec!["tumour".to_owned()]), ("kidney", vec![])];
        let colours = vec![None, srgb("#ff0080")];
        let object = |(name, regions): (&str, _)| Object {
            name: name.into(),
            regions,
            colours: colours.clone(),
            surface: surface.clone(),
        };
        let objects = names.map(object);
        let (document, binary) = parse(&encode(&objects));
        let listed = |list: &str| -> Vec<String> {
            document[list].as_array().unwrap().iter().map(|entry| entry["name"].as_str().unwrap().to_owned()).collect()
        };
        assert_eq!(listed("nodes"), ["liver", "kidney"]);
        assert_eq!(document["scenes"][0]["nodes"], json!([0, 1]));
        assert_eq!(listed("materials")[..3], ["liver", "liver, cut", "liver: tumour"]);
        let colours: Vec<_> =
            (0..3).map(|i| &document["materials"][i]["pbrMetallicRoughness"]["baseColorFactor"]).collect();
        assert!(colours[0] != colours[1] && colours[0] != colours[2]);
        // The tumour's is stated; 128 of 255 is 0.2159 of the light.
        assert_eq!((&colours[2][0], &colours[2][1]), (&json!(1.0), &json!(0.0)));
        assert!((colours[2][2].as_f64().unwrap() - 0.2159).abs() < 1e-4);
        // Each part has the triangles of its region and its kind.
        let parts = document["meshes"][0]["primitives"].as_array().unwrap();
        let counts: Vec<_> = parts
            .iter()
            .map(|part| &document["accessors"][part["indices"].as_u64().unwrap() as usize]["count"])
            .collect();
        assert_eq!(counts, [3, 6, 3]);
        // Skin and cut meet at two of the six places, each of which has a vertex on either side.
        let colours = view(&document, &binary, 2, 4);
        assert_eq!(colours.chunks(4).filter(|colour| *colour == SEAM).count(), 4);
    }

    #[test]
    fn an_empty_mesh_is_an_empty_scene() {
        let (document, binary) = parse(&encode(&[Object::default()]));
        assert_eq!((document["asset"]["version"].as_str(), binary.len()), (Some("2.0"), 0));
        assert!(document.get("buffers").is_none() && document.get("meshes").is_none());
    }
}
