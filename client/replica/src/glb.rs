//! Surfaces as binary glTF 2.0, metres, +y up: a node and a mesh for each piece of each object, and no vertex twice.
//!
//! A piece has a primitive for each region, with a material of the region's name: one of a single region is a closed
//! primitive, which readers that make a body of each primitive need. Those of several regions have the same vertices and
//! are closed together.
//!
//! Skin and what a blade laid open differ in the colours of their vertices. The material has the colour of cut faces, the
//! paler one, since what a vertex has of it is at most all. Where skin and cut meet there are lines, in a node below the
//! piece's: readers that merge a mesh's primitives expect triangles alone. The vertices there are dark, so that a cut is
//! seen as a seam while it is closed, also by readers that draw no lines.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::Path;

use kerf_proto::v1;
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
/// What is left of the material's colour where skin and cut meet.
const SEAM_DARKNESS: f32 = 0.02;

const LINES: u32 = 1;
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

impl Object {
    /// What a scene says of an object, with its surface.
    #[must_use]
    pub fn of(told: &v1::ObjectSummary, surface: Surface) -> Self {
        Self {
            name: told.name.clone(),
            regions: told.material_names.iter().skip(1).cloned().collect(),
            colours: told.material_colors.iter().map(|color| srgb(color)).collect(),
            surface,
        }
    }
}

/// Writes objects as a `.glb` file.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, objects: &[Object]) -> io::Result<()> {
    Document::of(objects).write(&mut File::create(path)?)
}

/// Objects as the bytes of a `.glb` file. Those without triangles are left out; without any the scene is empty.
#[must_use]
pub fn encode(objects: &[Object]) -> Vec<u8> {
    let mut file = Vec::new();
    Document::of(objects).write(&mut file).expect("memory takes all that is written");
    file
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
            vertex.is_on_skin |= triangle.face == Face::Skin;
            vertex.is_on_cut |= triangle.face == Face::Cut;
        }
    }
    vertices
}

/// Place of a region's material among all, and what of its colour the skin has, linear.
#[derive(Clone, Copy)]
struct Material {
    place: usize,
    of_skin: [f32; 3],
}

/// What is left of a material's colour at a vertex, linear, of 16 bits: dark ones would show steps of 8.
fn shade(vertex: Vertex, material: Material) -> [u16; 4] {
    let [r, g, b] = match (vertex.is_on_skin, vertex.is_on_cut) {
        (true, true) => [SEAM_DARKNESS; 3],
        (true, false) => material.of_skin,
        (false, _) => [1.0; 3],
    };
    [r, g, b, 1.0].map(|c| (c * f32::from(u16::MAX)).round() as u16)
}

/// Edges at which skin and what was laid open meet, each once.
fn seam(triangles: &[Triangle]) -> Vec<[u32; 2]> {
    let edges = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]].map(|[from, to]| [from.min(to), from.max(to)]);
    let of_face = |face: Face| {
        let triangles = triangles.iter().filter(move |triangle| triangle.face == face);
        triangles.flat_map(move |triangle| edges(triangle.vertices))
    };
    // Those of the skin, which are many, are kept nowhere.
    let of_cut: BTreeSet<[u32; 2]> = of_face(Face::Cut).collect();
    let seam: BTreeSet<[u32; 2]> = of_face(Face::Skin).filter(|edge| of_cut.contains(edge)).collect();
    seam.into_iter().collect()
}

/// Normal of a triangle with twice its area as length.
pub(crate) fn area_normal(surface: &Surface, triangle: &Triangle) -> [f32; 3] {
    let [a, b, c] = triangle.vertices.map(|v| surface.positions_m[v as usize]);
    let (u, v) = (subtract(b, a), subtract(c, a));
    std::array::from_fn(|i| u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3])
}

pub(crate) fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

fn subtract(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

pub(crate) fn unit(a: [f32; 3]) -> Option<[f32; 3]> {
    let length = dot(a, a).sqrt();
    (length > 0.0).then(|| a.map(|c| c / length))
}

/// A colour as the wire has it, "#rrggbb"; none where none is stated.
fn srgb(text: &str) -> Option<[u8; 3]> {
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
    /// The nodes that are in no other.
    roots: Vec<usize>,
    materials: Vec<Value>,
    /// Each region's material that there is, by the object's first region among all and the region.
    known_materials: BTreeMap<(usize, u16), Material>,
    /// Place of the material of seams, once there is one.
    seam_material: Option<usize>,
    /// Regions so far, of all objects.
    regions: usize,
}

impl Document {
    fn of(objects: &[Object]) -> Self {
        let mut document = Self::default();
        for object in objects.iter().filter(|object| !object.surface.triangles.is_empty()) {
            document.add(object);
        }
        document
    }

    /// Adds an object: a node with a mesh for each of its pieces.
    fn add(&mut self, object: &Object) {
        let vertices = vertices(&object.surface);
        let pieces = pieces(&object.surface);
        for (index, triangles) in pieces.iter().enumerate() {
            let name = if pieces.len() == 1 { object.name.clone() } else { format!("{} {}", object.name, index + 1) };
            let piece = self.add_piece(object, &name, &vertices, triangles);
            self.roots.push(piece);
        }
        self.regions += 1 + object.regions.len();
    }

    /// Adds a piece and its seams, and returns the place of its node.
    fn add_piece(&mut self, object: &Object, name: &str, vertices: &[Vertex], triangles: &[Triangle]) -> usize {
        let mut used: Vec<u32> = triangles.iter().flat_map(|triangle| triangle.vertices).collect();
        used.sort_unstable();
        used.dedup();
        let place = |vertex: u32| used.binary_search(&vertex).expect("a triangle's vertices are used") as u32;
        let positions_m: Vec<_> = used.iter().map(|vertex| object.surface.positions_m[*vertex as usize]).collect();
        let of = |vertex: &u32| vertices[*vertex as usize];
        let normals: Vec<_> = used.iter().map(|v| unit(of(v).normal).unwrap_or([0.0, 1.0, 0.0])).collect();

        let positions = self.positions(&positions_m);
        let count = positions_m.len();
        let described = json!({ "componentType": FLOAT, "count": count, "type": "VEC3" });
        let normals = self.accessor(&floats(&normals), ARRAY_BUFFER, described);

        let mut parts: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
        for triangle in triangles {
            let indices = parts.entry(triangle.region).or_default();
            indices.extend(triangle.vertices.into_iter().flat_map(|vertex| place(vertex).to_le_bytes()));
        }
        let mut primitives = Vec::new();
        for (region, indices) in parts {
            let material = self.material(object, region);
            let colours: Vec<[u16; 4]> = used.iter().map(|vertex| shade(of(vertex), material)).collect();
            let colours: Vec<u8> = colours.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect();
            let described =
                json!({ "componentType": UNSIGNED_SHORT, "normalized": true, "count": count, "type": "VEC4" });
            let colours = self.accessor(&colours, ARRAY_BUFFER, described);
            let described = json!({ "componentType": UNSIGNED_INT, "count": indices.len() / 4, "type": "SCALAR" });
            let indices = self.accessor(&indices, ELEMENT_ARRAY_BUFFER, described);
            primitives.push(json!({
                "attributes": { "POSITION": positions, "NORMAL": normals, "COLOR_0": colours },
                "indices": indices,
                "material": material.place,
            }));
        }
        let mut node = json!({ "mesh": self.meshes.len(), "name": name });
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        let seam_m: Vec<_> =
            seam(triangles).into_iter().flatten().map(|vertex| object.surface.positions_m[vertex as usize]).collect();
        if !seam_m.is_empty() {
            node["children"] = json!([self.add_seam(&format!("{name} seam"), &seam_m)]);
        }
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Adds lines between each two of these places, and returns the place of their node. They have vertices of their own:
    /// some readers of lines look at no indices.
    fn add_seam(&mut self, name: &str, ends_m: &[[f32; 3]]) -> usize {
        let positions = self.positions(ends_m);
        let material = *self.seam_material.get_or_insert_with(|| {
            self.materials.push(json!({
                "name": "seam",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0,
                },
            }));
            self.materials.len() - 1
        });
        self.nodes.push(json!({ "mesh": self.meshes.len(), "name": name }));
        self.meshes.push(json!({ "name": name, "primitives": [{
            "attributes": { "POSITION": positions }, "mode": LINES, "material": material,
        }] }));
        self.nodes.len() - 1
    }

    /// The material of a region, in the colour of what was laid open in it.
    fn material(&mut self, object: &Object, region: u16) -> Material {
        if let Some(known) = self.known_materials.get(&(self.regions, region)) {
            return *known;
        }
        let index = usize::from(region);
        let stated = object.colours.get(index).copied().flatten().map(|srgb| srgb.map(linear));
        let skin = stated.unwrap_or(SKIN_COLOURS[(self.regions + index) % SKIN_COLOURS.len()]);
        let name = index.checked_sub(1).and_then(|index| object.regions.get(index)).unwrap_or(&object.name);
        let [r, g, b] = skin.map(|c| c + CUT_PALENESS * (1.0 - c));
        self.materials.push(json!({
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.55,
            },
        }));
        let of_skin = [skin[0] / r, skin[1] / g, skin[2] / b];
        let material = Material { place: self.materials.len() - 1, of_skin };
        self.known_materials.insert((self.regions, region), material);
        material
    }

    /// Adds places, m, with their bounds.
    fn positions(&mut self, positions_m: &[[f32; 3]]) -> usize {
        let bound = |pick: fn(f32, f32) -> f32| {
            positions_m.iter().copied().reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
        };
        let described = json!({ "componentType": FLOAT, "count": positions_m.len(), "type": "VEC3",
                                "min": bound(f32::min), "max": bound(f32::max) });
        self.accessor(&floats(positions_m), ARRAY_BUFFER, described)
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

    /// Writes the header and the chunks, each padded to four bytes.
    fn write(mut self, file: &mut impl io::Write) -> io::Result<()> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "Kerf" },
            "scene": 0,
            "scenes": [{}],
        });
        if !self.nodes.is_empty() {
            document["scenes"] = json!([{ "nodes": self.roots }]);
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
        file.write_all(&[*b"glTF", 2u32.to_le_bytes(), (length as u32).to_le_bytes()].concat())?;
        for (kind, data) in chunks {
            file.write_all(&[(data.len() as u32).to_le_bytes(), kind].concat())?;
            file.write_all(&data)?;
        }
        Ok(())
    }
}

fn floats(values: &[[f32; 3]]) -> Vec<u8> {
    values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use gltf::Gltf;
    use gltf::mesh::Mode;

    use super::*;

    /// What another reader makes of a file that it finds sound.
    fn read(objects: &[Object]) -> (Gltf, Vec<u8>) {
        let mut file = Gltf::from_slice(&encode(objects)).expect("a sound file");
        let binary = file.blob.take().unwrap_or_default();
        (file, binary)
    }

    /// A mesh with the triangles of all its primitives, after a check that they have the same vertices.
    fn merged(mesh: &gltf::Mesh<'_>, binary: &[u8]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let of = |primitive: &gltf::Primitive<'_>| {
            primitive.get(&gltf::Semantic::Positions).map(|positions| positions.index())
        };
        let (mut positions_m, mut indices) = (Vec::new(), Vec::new());
        let first = mesh.primitives().next().expect("a primitive");
        for primitive in mesh.primitives() {
            assert_eq!((primitive.mode(), of(&primitive)), (Mode::Triangles, of(&first)));
            let reader = primitive.reader(|_| Some(binary));
            positions_m = reader.read_positions().expect("positions").collect();
            indices.extend(reader.read_indices().expect("indices").into_u32());
        }
        (positions_m, indices.as_chunks::<3>().0.to_vec())
    }

    /// What is seen at the vertices, linear: the colour of the material by theirs, of 16 bits.
    fn colours(primitive: &gltf::Primitive<'_>, binary: &[u8]) -> Vec<[f32; 3]> {
        let [r, g, b, _] = primitive.material().pbr_metallic_roughness().base_color_factor();
        let colours = primitive.reader(|_| Some(binary)).read_colors(0).expect("colours");
        assert!(matches!(colours, gltf::mesh::util::ReadColors::RgbaU16(_)));
        colours.into_rgba_f32().map(|of| [r * of[0], g * of[1], b * of[2]]).collect()
    }

    fn is_near(colour: [f32; 3], expected: [f32; 3]) -> bool {
        (0..3).all(|c| (colour[c] - expected[c]).abs() < 1e-4)
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
    fn a_mesh_reads_back_with_its_bounds_normals_and_colour() {
        let surface = roof(30.0, Face::Skin);
        let (file, binary) = read(&[Object { name: "roof".into(), surface: surface.clone(), ..Object::default() }]);
        let mesh = file.meshes().next().expect("a mesh");
        let [primitive] = &mesh.primitives().collect::<Vec<_>>()[..] else { panic!("one primitive") };
        let bounds = primitive.bounding_box();
        for (axis, (low, high)) in [(-1.0, 0.75f32.sqrt()), (-0.5, 0.0), (0.0, 1.0)].into_iter().enumerate() {
            assert!((bounds.min[axis] - low).abs() < 1e-6 && (bounds.max[axis] - high).abs() < 1e-6, "axis {axis}");
        }
        let (positions_m, triangles) = merged(&mesh, &binary);
        let expected = surface.triangles.iter().flat_map(|t| t.vertices).map(|v| surface.positions_m[v as usize]);
        assert!(triangles.into_iter().flatten().map(|i| positions_m[i as usize]).eq(expected));
        let reader = primitive.reader(|_| Some(&binary[..]));
        for normal in reader.read_normals().expect("normals") {
            assert!((dot(normal, normal) - 1.0).abs() < 1e-5 && normal[1] > 0.8, "{normal:?}");
        }
        assert_eq!(primitive.material().name(), Some("roof"));
        for colour in colours(primitive, &binary) {
            assert!(is_near(colour, [0.50, 0.09, 0.06]), "{colour:?}: all is skin");
        }
        assert_eq!(file.nodes().len(), 1);
    }

    #[test]
    fn skin_and_cut_differ_in_the_colours_of_their_vertices_and_meet_in_a_line() {
        let (file, binary) =
            read(&[Object { surface: roof(30.0, Face::Cut), name: "roof".into(), ..Object::default() }]);
        let [piece] = &file.scenes().next().expect("a scene").nodes().collect::<Vec<_>>()[..] else { panic!("a node") };
        let mesh = piece.mesh().expect("a mesh");
        let [both] = &mesh.primitives().collect::<Vec<_>>()[..] else { panic!("one primitive") };
        let cut = [0.70, 0.454, 0.436];
        let [r, g, b, _] = both.material().pbr_metallic_roughness().base_color_factor();
        assert!(is_near([r, g, b], cut), "two fifths of the way from the skin's colour to white");
        // Two of the skin's, two where both meet, two of the cut's.
        let shown = colours(both, &binary);
        for (vertex, expected) in [(0, [0.50, 0.09, 0.06]), (2, cut.map(|c| 0.02 * c)), (4, cut)] {
            assert!(is_near(shown[vertex], expected) && is_near(shown[vertex + 1], expected), "{vertex}: {shown:?}");
        }
        let [seam] = &piece.children().collect::<Vec<_>>()[..] else { panic!("a node") };
        let mesh = seam.mesh().expect("a mesh");
        assert_eq!((seam.name(), mesh.primitives().len()), (Some("roof seam"), 1));
        let lines = mesh.primitives().next().expect("a primitive");
        let ends_m: Vec<_> = lines.reader(|_| Some(&binary[..])).read_positions().expect("positions").collect();
        assert_eq!((lines.mode(), lines.material().name()), (Mode::Lines, Some("seam")));
        assert_eq!(ends_m, [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]);
    }

    /// A closed body: every edge of its triangles is passed once each way, and no vertex is there twice.
    fn assert_is_closed(mesh: &gltf::Mesh<'_>, binary: &[u8], volume_m3: f32) {
        let (positions_m, triangles) = merged(mesh, binary);
        let edges: BTreeSet<_> = triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]).collect();
        assert_eq!(edges.len(), 3 * triangles.len());
        assert!(edges.iter().all(|(a, b)| edges.contains(&(*b, *a))));
        let places: BTreeSet<_> = positions_m.iter().map(|place| place.map(f32::to_bits)).collect();
        assert_eq!(places.len(), positions_m.len());
        let volume = |[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|vertex| positions_m[*vertex as usize]);
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
        let (file, binary) = read(&[object("liver"), one]);
        let nodes: Vec<_> = file.scenes().next().expect("a scene").nodes().collect();
        let names: Vec<_> = nodes.iter().map(gltf::Node::name).collect();
        assert_eq!(names, ["liver 1", "liver 2", "kidney"].map(Some));
        nodes[..2].iter().for_each(|node| assert_is_closed(&node.mesh().expect("a mesh"), &binary, 1.0 / 6.0));
        // Three edges of each face that was laid open, and none of what was not cut.
        let lines = |node: &gltf::Node<'_>| {
            let seams = node.children().filter_map(|child| child.mesh()).flat_map(|mesh| mesh.primitives());
            seams.map(|lines| lines.get(&gltf::Semantic::Positions).expect("positions").count() / 2).sum::<usize>()
        };
        assert_eq!(nodes.iter().map(lines).collect::<Vec<_>>(), [3, 3, 0]);
        // A body of one region is one primitive: whoever makes a body of each finds it closed.
        assert!(nodes.iter().all(|node| node.mesh().expect("a mesh").primitives().len() == 1));
        // The second piece is of the tumour, whose skin has the stated colour: 128 of 255 is 0.2159 of the light.
        let second = nodes[1].mesh().expect("a mesh").primitives().next().expect("a primitive");
        assert_eq!(second.material().name(), Some("tumour"));
        let tip = colours(&second, &binary)[3];
        assert!(is_near(tip, [1.0, 0.0, 0.2159]), "{tip:?}");
        assert_eq!(file.materials().len(), 4, "two regions, the kidney, and seams");
    }

    #[test]
    fn a_region_within_a_piece_is_a_primitive_and_the_piece_stays_closed() {
        let mut surface = parted();
        surface.triangles.iter_mut().for_each(|triangle| triangle.region = u16::from(triangle.vertices.contains(&3)));
        let object = Object { name: "liver".into(), regions: vec!["tumour".into()], surface, ..Object::default() };
        let (file, binary) = read(&[object]);
        let first = file.scenes().next().expect("a scene").nodes().next().and_then(|node| node.mesh()).expect("a mesh");
        let names: Vec<_> = first.primitives().map(|part| part.material().name().map(str::to_owned)).collect();
        assert_eq!(names, ["liver", "tumour"].map(|name| Some(name.to_owned())));
        // Skin has what of each material's colour makes its own.
        let tips: Vec<_> = first.primitives().map(|part| colours(&part, &binary)[3]).collect();
        assert!(is_near(tips[0], [0.50, 0.09, 0.06]) && is_near(tips[1], [0.72, 0.48, 0.14]), "{tips:?}");
        assert_is_closed(&first, &binary, 1.0 / 6.0);
    }

    /// Without a node, which glTF allows and the other reader does not.
    #[test]
    fn an_empty_mesh_is_an_empty_scene() {
        let glb = encode(&[Object::default()]);
        let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
        let document: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
        assert_eq!((document["asset"]["version"].as_str(), glb.len()), (Some("2.0"), 20 + length));
        assert!(
            document["scenes"] == json!([{}]) && document.get("buffers").is_none() && document.get("meshes").is_none()
        );
    }
}
