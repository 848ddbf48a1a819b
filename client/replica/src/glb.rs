//! Surfaces as binary glTF 2.0, metres, +y up: a node and a mesh for each piece of each object, and no vertex twice, so that
//! a piece is a closed body to whoever reads it.
//!
//! What is skin, what a blade laid open, and of which region it is, is told by the vertices' colours: parts with materials
//! of their own would be open surfaces. Vertices at which skin and cut meet are dark, so that a cut is seen as a seam
//! while it is closed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};

use crate::surface::{Face, Surface, Triangle};

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
/// What is left of the skin's colour where it meets a cut.
const SEAM_DARKNESS: f32 = 0.02;

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNSIGNED_SHORT: u32 = 5123;
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

/// Triangles of each closed surface that no triangle joins to another, the largest first.
#[must_use]
pub fn pieces(surface: &Surface) -> Vec<Vec<Triangle>> {
    let mut parent: Vec<u32> = (0..surface.positions_m.len() as u32).collect();
    fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
        while parent[vertex as usize] != vertex {
            parent[vertex as usize] = parent[parent[vertex as usize] as usize];
            vertex = parent[vertex as usize];
        }
        vertex
    }
    for Triangle { vertices: [a, b, c], .. } in &surface.triangles {
        for other in [*b, *c] {
            let (one, other) = (root(&mut parent, *a), root(&mut parent, other));
            parent[other as usize] = one;
        }
    }
    let mut pieces: BTreeMap<u32, Vec<Triangle>> = BTreeMap::new();
    for triangle in &surface.triangles {
        pieces.entry(root(&mut parent, triangle.vertices[0])).or_default().push(*triangle);
    }
    let mut pieces: Vec<_> = pieces.into_values().collect();
    pieces.sort_by_key(|triangles| std::cmp::Reverse(triangles.len()));
    pieces
}

/// What a vertex is of, from the triangles around it.
#[derive(Clone, Copy, Default)]
struct Vertex {
    normal: [f32; 3],
    region: u16,
    is_on_skin: bool,
    is_on_cut: bool,
}

fn vertices(surface: &Surface) -> Vec<Vertex> {
    let mut vertices = vec![Vertex::default(); surface.positions_m.len()];
    for triangle in &surface.triangles {
        let normal = area_normal(surface, triangle);
        for vertex in triangle.vertices {
            let vertex = &mut vertices[vertex as usize];
            vertex.normal = add(vertex.normal, normal);
            vertex.region = vertex.region.max(triangle.region);
            vertex.is_on_skin |= triangle.face == Face::Skin;
            vertex.is_on_cut |= triangle.face == Face::Cut;
        }
    }
    vertices
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
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    /// Regions so far, of all objects.
    regions: usize,
}

impl Document {
    /// Adds an object: a node with a mesh for each of its pieces.
    fn add(&mut self, object: &Object) {
        let vertices = vertices(&object.surface);
        let pieces = pieces(&object.surface);
        for (index, triangles) in pieces.iter().enumerate() {
            let name = if pieces.len() == 1 { object.name.clone() } else { format!("{} {}", object.name, index + 1) };
            self.add_piece(object, &name, &vertices, triangles);
        }
        self.regions += 1 + object.regions.len();
    }

    fn add_piece(&mut self, object: &Object, name: &str, vertices: &[Vertex], triangles: &[Triangle]) {
        let used: BTreeSet<u32> = triangles.iter().flat_map(|triangle| triangle.vertices).collect();
        let place: BTreeMap<u32, u32> = used.iter().zip(0..).map(|(vertex, place)| (*vertex, place)).collect();
        let positions_m: Vec<_> = used.iter().map(|vertex| object.surface.positions_m[*vertex as usize]).collect();
        let of = |vertex: &u32| vertices[*vertex as usize];
        let normals: Vec<_> = used.iter().map(|v| unit(of(v).normal).unwrap_or([0.0, 1.0, 0.0])).collect();
        let colours: Vec<[u16; 4]> = used.iter().map(|vertex| self.colour(object, of(vertex))).collect();
        let indices: Vec<u8> =
            triangles.iter().flat_map(|t| t.vertices).flat_map(|vertex| place[&vertex].to_le_bytes()).collect();

        let bound = |pick: fn(f32, f32) -> f32| {
            positions_m.iter().copied().reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
        };
        let count = positions_m.len();
        let described = json!({ "componentType": FLOAT, "count": count, "type": "VEC3",
                                "min": bound(f32::min), "max": bound(f32::max) });
        let positions = self.accessor(&floats(&positions_m), ARRAY_BUFFER, described);
        let described = json!({ "componentType": FLOAT, "count": count, "type": "VEC3" });
        let normals = self.accessor(&floats(&normals), ARRAY_BUFFER, described);
        let described = json!({ "componentType": UNSIGNED_SHORT, "normalized": true, "count": count, "type": "VEC4" });
        let colours: Vec<u8> = colours.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect();
        let colours = self.accessor(&colours, ARRAY_BUFFER, described);
        let described = json!({ "componentType": UNSIGNED_INT, "count": 3 * triangles.len(), "type": "SCALAR" });
        let indices = self.accessor(&indices, ELEMENT_ARRAY_BUFFER, described);
        self.nodes.push(json!({ "mesh": self.meshes.len(), "name": name }));
        self.meshes.push(json!({ "name": name, "primitives": [{
            "attributes": { "POSITION": positions, "NORMAL": normals, "COLOR_0": colours },
            "indices": indices,
            "material": 0,
        }] }));
    }

    /// Linear, of 16 bits: dark ones would show steps of 8.
    fn colour(&self, object: &Object, vertex: Vertex) -> [u16; 4] {
        let region = usize::from(vertex.region);
        let stated = object.colours.get(region).copied().flatten().map(|srgb| srgb.map(linear));
        let skin = stated.unwrap_or(SKIN_COLOURS[(self.regions + region) % SKIN_COLOURS.len()]);
        let [r, g, b] = match (vertex.is_on_skin, vertex.is_on_cut) {
            (true, true) => skin.map(|c| SEAM_DARKNESS * c),
            (false, true) => skin.map(|c| c + CUT_PALENESS * (1.0 - c)),
            _ => skin,
        };
        [r, g, b, 1.0].map(|c| (c * f32::from(u16::MAX)).round() as u16)
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
                (
                    "materials",
                    vec![json!({
                        "name": "tissue",
                        "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.55 },
                    })],
                ),
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
        let first = view(&document, &binary, 2, 8).chunks(2).next().unwrap();
        assert_eq!(u16::from_le_bytes(first.try_into().unwrap()), (0.5 * 65535.0f32).round() as u16);
    }

    /// A closed body: every edge of its triangles is passed once each way, and no vertex is there twice.
    fn assert_is_closed(document: &serde_json::Value, binary: &[u8], mesh: usize, volume_m3: f32) {
        let part = &document["meshes"][mesh]["primitives"][0];
        let number = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
        let positions = vectors(view(document, binary, number(&part["attributes"]["POSITION"]), 12));
        let indices = view(document, binary, number(&part["indices"]), 4);
        let indices: Vec<u32> = indices.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
        let (triangles, _) = indices.as_chunks::<3>();
        let edges: BTreeSet<_> = triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]).collect();
        assert_eq!(edges.len(), indices.len());
        assert!(edges.iter().all(|(a, b)| edges.contains(&(*b, *a))));
        let places: BTreeSet<_> = positions.iter().map(|place| place.map(f32::to_bits)).collect();
        assert_eq!(places.len(), positions.len());
        let volume = |[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|vertex| positions[*vertex as usize]);
            let cross: [f32; 3] =
                std::array::from_fn(|i| b[(i + 1) % 3] * c[(i + 2) % 3] - b[(i + 2) % 3] * c[(i + 1) % 3]);
            dot(a, cross) / 6.0
        };
        assert!((triangles.iter().map(volume).sum::<f32>() - volume_m3).abs() < 1e-5);
    }

    /// Two tetrahedra that touch with a face each, as if a blade had parted them.
    fn parted() -> Surface {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mut surface = Surface::default();
        for (tip, flips) in [([0.0, 0.0, 1.0], false), ([0.0, 0.0, -1.0], true)] {
            let first = surface.positions_m.len() as u32;
            surface.positions_m.extend(corners);
            surface.positions_m.push(tip);
            for (mut vertices, face) in
                [([0, 2, 1], Face::Cut), ([0, 1, 3], Face::Skin), ([1, 2, 3], Face::Skin), ([2, 0, 3], Face::Skin)]
            {
                if flips {
                    vertices.swap(0, 1);
                }
                let vertices = vertices.map(|vertex| first + vertex);
                surface.triangles.push(Triangle { vertices, face, region: u16::from(flips) });
            }
        }
        surface
    }

    #[test]
    fn pieces_are_nodes_and_closed_though_their_walls_touch() {
        let object = |name: &str| Object {
            name: name.into(),
            regions: vec!["tumour".to_owned()],
            colours: vec![None, srgb("#ff0080")],
            surface: parted(),
        };
        let one = Object { name: "kidney".into(), surface: roof(30.0, Face::Skin), ..Object::default() };
        let (document, binary) = parse(&encode(&[object("liver"), one]));
        let names: Vec<_> = document["nodes"].as_array().unwrap().iter().map(|node| node["name"].as_str()).collect();
        assert_eq!(names, ["liver 1", "liver 2", "kidney"].map(Some));
        assert_eq!(document["scenes"][0]["nodes"], json!([0, 1, 2]));
        (0..2).for_each(|mesh| assert_is_closed(&document, &binary, mesh, 1.0 / 6.0));
        // Of the second piece, which is of the tumour, the tip is skin of the colour that is stated, and the rim dark.
        let colours = document["meshes"][1]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize;
        let colours: Vec<u16> =
            view(&document, &binary, colours, 8).chunks(2).map(|b| u16::from_le_bytes(b.try_into().unwrap())).collect();
        // 128 of 255 is 0.2159 of the light.
        assert_eq!((colours[12], colours[13]), (65535, 0));
        assert!((f32::from(colours[14]) / 65535.0 - 0.2159).abs() < 1e-4);
        assert!(colours[0] < 2000, "{colours:?}");
    }

    #[test]
    fn an_empty_mesh_is_an_empty_scene() {
        let (document, binary) = parse(&encode(&[Object::default()]));
        assert_eq!((document["asset"]["version"].as_str(), binary.len()), (Some("2.0"), 0));
        assert!(document.get("buffers").is_none() && document.get("meshes").is_none());
    }
}
