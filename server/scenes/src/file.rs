//! Scenes from files, with the files beside them that they name; and from text, with the files that were sent with it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io;
use std::path::{Path, PathBuf};

use kerf_physics::scene::{EdgeDesc, Meshes, ShapeDesc, ToolShapeDesc, TriangleMesh};
use kerf_physics::{Scene, SceneDesc, SceneError, SceneProblems, SoundScene};

use crate::error::ReadError;
use crate::label_map::{self, LabelMap};
use crate::{edge_file, label_map_file, label_surface, mesh_file};

/// Largest scene file, bytes: a thousand times a large scene written by hand.
pub const MAX_SCENE_BYTES: u64 = 4 << 20;
/// Largest mesh or label map file, bytes: some five million triangles in binary.
pub const MAX_MESH_BYTES: u64 = 256 << 20;
/// Largest file of an edge's points, bytes: more than as many points as an edge may have.
pub const MAX_EDGE_BYTES: u64 = 1 << 20;
/// Most voxels of the label maps that were sent with a scene: 256 slices of 256 x 256, 32 MB.
const MAX_SENT_LABEL_VOXELS: u64 = 1 << 24;
/// Most numbers that the meshes that were sent with a scene may unpack to: some two million tetrahedra.
const MAX_SENT_MESH_NUMBERS: u64 = 1 << 24;
/// Voxels for each quad of the surfaces of label maps, of those that there may be: a solid's surface has far fewer. What a
/// small file unpacks to may alternate from voxel to voxel, and a quad takes a hundred times the memory of a voxel.
const VOXELS_PER_QUAD: u64 = 8;
/// Most shapes and edges of a scene that files are read for, each of which takes seconds at the most: those of a segmentation
/// of the whole body.
const MAX_READ: usize = 256;
/// How much of a name is repeated to who sent it.
const MAX_NAME_CHARS: usize = 64;

/// The files that a scene may refer to.
enum Files<'a> {
    /// Those beside it.
    Beside(&'a Path),
    /// Those that were sent with it, by the names that it has for them.
    Sent(&'a SentFiles),
}

/// Files that were sent with a scene's text, by name.
pub type SentFiles = BTreeMap<String, Vec<u8>>;

impl Files<'_> {
    /// A file's bytes, and what it is called in what is wrong with it.
    fn read(&self, name: &str, limit: u64) -> Result<(PathBuf, Cow<'_, [u8]>), ReadError> {
        match self {
            Self::Beside(folder) => {
                let path = folder.join(name);
                read(&path, limit).map(|bytes| (path, bytes.into()))
            }
            Self::Sent(files) => match files.get(name) {
                Some(bytes) => Ok((name.into(), bytes.into())),
                None => Err(ReadError::NotSent { name: name.chars().take(MAX_NAME_CHARS).collect() }),
            },
        }
    }

    /// What they may unpack to: what was sent is less to be trusted, and unpacked on a machine that others use.
    fn room(&self) -> Room {
        let (voxels, numbers) = match self {
            Self::Beside(_) => (label_map::MAX_VOXELS, mesh_file::MAX_NUMBERS),
            Self::Sent(_) => (MAX_SENT_LABEL_VOXELS, MAX_SENT_MESH_NUMBERS),
        };
        Room { voxels, quads: voxels / VOXELS_PER_QUAD, numbers, reads: MAX_READ }
    }
}

/// What is left of what the files of a scene may unpack to, in all.
struct Room {
    /// Voxels of label maps.
    voxels: u64,
    /// Quads of their surfaces.
    quads: u64,
    /// Numbers of meshes that are packed.
    numbers: u64,
    /// Shapes and edges.
    reads: usize,
}

impl Room {
    fn take_read(&mut self) -> Result<(), ReadError> {
        self.reads = self.reads.checked_sub(1).ok_or(ReadError::TooManyFiles { limit: MAX_READ })?;
        Ok(())
    }
}

/// A scene whose values are not judged yet.
#[derive(Debug)]
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    /// What it was read from.
    pub text: SceneText,
}

/// The text of a scene: what is wrong with a value is said with the value's place in it.
#[derive(Debug)]
pub struct SceneText {
    name: String,
    text: String,
}

impl Opened {
    /// The scene of a text that names no files.
    pub(crate) fn of_text(name: &str, text: &str) -> Result<Self, SceneError> {
        let scene = Scene { desc: SceneDesc::from_toml(name, text)?, meshes: Meshes::new() };
        Ok(Self { scene, text: SceneText { name: name.to_owned(), text: text.to_owned() } })
    }

    /// The scene, if all its values are supported, and its text.
    ///
    /// # Errors
    /// Every value that is not.
    pub fn judge(self) -> Result<(SoundScene, SceneText), ReadError> {
        let Self { scene, text } = self;
        let scene = scene.judge().map_err(|problems| text.refused(problems))?;
        Ok((scene, text))
    }
}

impl SceneText {
    /// A problem or a warning with its place.
    #[must_use]
    pub fn placed(&self, problem: SceneError) -> SceneError {
        problem.placed(&self.name, &self.text)
    }

    /// Problems as an error, each with its place.
    #[must_use]
    pub fn refused(&self, SceneProblems(problems): SceneProblems) -> ReadError {
        let problems = problems.into_iter().map(|problem| self.placed(problem)).collect();
        ReadError::Invalid { name: self.name.clone(), problems }
    }
}

/// A scene from a file with its meshes, edges from files as the polylines they are; its values are not
/// judged.
///
/// # Errors
/// The first file that cannot be had or read.
pub fn open(path: &Path) -> Result<Opened, ReadError> {
    let name = path.display().to_string();
    if !path.is_file() {
        return Err(ReadError::NotFound { name });
    }
    let bytes = read(path, MAX_SCENE_BYTES)?;
    let text = str::from_utf8(&bytes)
        .map_err(|_| ReadError::Read { path: path.to_owned(), message: "is not text in UTF-8".into() })?;
    with_files(Opened::of_text(&name, text)?, &Files::Beside(path.parent().unwrap_or(Path::new(""))))
}

/// A scene from a text that is called `name` in what is wrong with it, and the files that were sent with it. It may
/// refer to no others: they would be those of the machine that reads it.
///
/// # Errors
/// What is wrong with the text, the first file that was not sent or cannot be read, or every value that is not supported.
pub fn from_text(name: &str, text: &str, files: &SentFiles) -> Result<SoundScene, ReadError> {
    Ok(with_files(Opened::of_text(name, text)?, &Files::Sent(files))?.judge()?.0)
}

/// The scene with what the files hold that it refers to.
fn with_files(mut opened: Opened, files: &Files<'_>) -> Result<Opened, ReadError> {
    let Scene { desc, meshes } = &mut opened.scene;
    let mut room = files.room();
    read_edges(desc, files, &mut room)?;
    let mut label_maps = BTreeMap::new();
    for shape in desc.objects.iter().flat_map(|object| object.shapes()) {
        let Some(mesh) = shape.mesh().filter(|mesh| !meshes.contains_key(&mesh.key)) else { continue };
        room.take_read()?;
        let read = match shape {
            ShapeDesc::LabelMap { file, labels, .. } => read_labels(files, file, labels, &mut label_maps, &mut room)?,
            _ => {
                let (path, bytes) = files.read(&mesh.key, MAX_MESH_BYTES)?;
                let mesh = mesh_file::parse(&path, &bytes, room.numbers);
                let mesh = mesh.map_err(|message| ReadError::Mesh { path, message })?;
                // What a file has that is not packed is limited by its bytes: no format has a number in less than two.
                let unpacked = 3 * (mesh.positions.len() + mesh.triangles.len()) as u64;
                room.numbers = room.numbers.saturating_sub(unpacked.saturating_sub(bytes.len() as u64 / 2));
                mesh
            }
        };
        meshes.insert(mesh.key, read);
    }
    Ok(opened)
}

/// Reads one mesh file.
///
/// # Errors
/// The file cannot be read, is too large, or is not the mesh that its extension says.
pub fn read_mesh(path: &Path) -> Result<TriangleMesh, ReadError> {
    let bytes = read(path, MAX_MESH_BYTES)?;
    mesh_file::parse(path, &bytes, mesh_file::MAX_NUMBERS)
        .map_err(|message| ReadError::Mesh { path: path.to_owned(), message })
}

/// Puts the points in the place of each edge that names a file: they are few, and the scene is whole then.
fn read_edges(desc: &mut SceneDesc, files: &Files<'_>, room: &mut Room) -> Result<(), ReadError> {
    for tool in &mut desc.tools {
        let ToolShapeDesc::Blade(blade) = &mut tool.shape else { continue };
        if let EdgeDesc::File { file, scale_m_per_unit } = &blade.edge {
            room.take_read()?;
            let (path, bytes) = files.read(file, MAX_EDGE_BYTES)?;
            let points_m = edge_file::parse(&bytes, *scale_m_per_unit)
                .map_err(|message| ReadError::Edge { path: path.clone(), message })?;
            blade.edge = EdgeDesc::Polyline { points_m };
        }
    }
    Ok(())
}

/// The surface of some labels of a map, which is read where it is not among those read before.
fn read_labels(
    files: &Files<'_>,
    file: &str,
    labels: &[u16],
    read_before: &mut BTreeMap<String, LabelMap>,
    room: &mut Room,
) -> Result<TriangleMesh, ReadError> {
    let wrong = |message| ReadError::Mesh { path: file.into(), message };
    let map = match read_before.entry(file.to_owned()) {
        Entry::Occupied(known) => known.into_mut(),
        Entry::Vacant(new) => {
            let (path, bytes) = files.read(file, MAX_MESH_BYTES)?;
            let map = label_map_file::parse(&bytes, room.voxels);
            let map = map.map_err(|message| ReadError::Mesh { path, message })?;
            room.voxels -= map.labels.len() as u64;
            new.insert(map)
        }
    };
    let surface = label_surface::surface(map, labels, room.quads).map_err(wrong)?;
    // Two triangles each.
    room.quads -= surface.triangles.len() as u64 / 2;
    Ok(surface)
}

fn read(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    let failed = |error: io::Error| ReadError::Read { path: path.to_owned(), message: in_plain_words(&error) };
    let bytes = std::fs::metadata(path).map_err(failed)?.len();
    if bytes > limit {
        return Err(ReadError::TooLarge { path: path.to_owned(), bytes, limit });
    }
    std::fs::read(path).map_err(failed)
}

/// What the system says, without its number.
pub(crate) fn in_plain_words(error: &io::Error) -> String {
    let said = error.to_string();
    said.split(" (os error").next().unwrap_or_default().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_from_a_file_is_in_the_scene_once_it_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let jelly = include_str!("../builtin/jelly.toml");
        let blade = "{ blade = { width_m = 0.04, height_m = 0.05, edge = { file = { file = \"teeth.csv\", \
                     scale_m_per_unit = 1e-3 } } } }";
        let tool =
            |line: &str| if line.starts_with("shape = { blade") { format!("shape = {blade}") } else { line.into() };
        let path = folder.path().join("jelly.toml");
        std::fs::write(&path, jelly.lines().map(|line| tool(line) + "\n").collect::<String>()).unwrap();
        let missing = open(&path).unwrap_err().to_string();
        std::fs::write(folder.path().join("teeth.csv"), "-20,0,-2\n0,0,2\n20,0,-2\n").unwrap();
        let scene = open(&path);
        std::fs::write(folder.path().join("teeth.csv"), "-20,0,-2\n0,0\n").unwrap();
        let broken = open(&path).unwrap_err().to_string();
        let ToolShapeDesc::Blade(blade) = &scene.unwrap().scene.desc.tools[0].shape else { panic!("a blade") };
        let points_m = [[-20.0, 0.0, -2.0], [0.0, 0.0, 2.0], [20.0, 0.0, -2.0]].map(|p| p.map(|x: f64| x * 1e-3));
        assert_eq!(blade.edge, EdgeDesc::Polyline { points_m: points_m.to_vec() });
        assert!(missing.contains("teeth.csv"), "{missing}");
        assert!(broken.contains("teeth.csv: line 2"), "{broken}");
    }

    #[test]
    fn a_mesh_is_read_once_from_beside_the_scene_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        let mesh = r#"{ mesh = { file = "tetrahedron.obj", scale_m_per_unit = 0.1 } }"#;
        std::fs::write(&path, scene(mesh) + &format!("fixed = [{mesh}]\n")).unwrap();
        let missing = open(&path).unwrap_err().to_string();
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
        std::fs::write(folder.path().join("tetrahedron.obj"), format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"))
            .unwrap();
        let read = open(&path).unwrap();
        assert!(missing.contains("tetrahedron.obj"), "{missing}");
        assert_eq!(read.scene.meshes.len(), 1);
        assert_eq!(read.scene.meshes["tetrahedron.obj"].triangles.len(), 4);
    }

    fn scene(shape: &str) -> String {
        let material = "material = { young_modulus_pa = 1e3, poisson_ratio = 0.4 }";
        format!("version = 1\nname = \"x\"\n[[objects]]\nname = \"x\"\nresolution = 8\nshape = {shape}\n{material}\n")
    }

    #[test]
    fn a_scene_sent_as_text_may_name_what_was_sent_with_it_and_nothing_else() {
        let none = SentFiles::new();
        let refused = |shape: &str| matches!(from_text("x.toml", &scene(shape), &none), Err(ReadError::NotSent { .. }));
        let mesh = r#"{ mesh = { file = "/etc/passwd", scale_m_per_unit = 1.0 } }"#;
        assert!(refused(mesh));
        assert!(refused(r#"{ label_map = { file = "/etc/passwd" } }"#));
        let union = format!("{{ smooth_union = {{ blend_m = 0.0, parts = [{mesh}] }} }}");
        assert!(from_text("x.toml", &scene(&union), &none).is_err());
        let sphere = "{ sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }";
        let finer = scene(sphere) + &format!("finer = [{{ shape = {mesh}, level = 1 }}]\n");
        assert!(matches!(from_text("x.toml", &finer, &none), Err(ReadError::NotSent { .. })));
        assert!(from_text("x.toml", &scene(sphere), &none).is_ok());

        let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
        let sent = SentFiles::from([("../a/b.obj".to_owned(), tetrahedron.into())]);
        let named = scene(r#"{ mesh = { file = "../a/b.obj", scale_m_per_unit = 0.1 } }"#);
        assert_eq!(from_text("x.toml", &named, &sent).unwrap().meshes["../a/b.obj"].triangles.len(), 4);
    }

    /// A map whose voxels are in and out by turns, in bytes; packed it would be a thousandth of that.
    fn checkered(side: usize) -> Vec<u8> {
        let mut bytes = vec![0; 352];
        let mut put = |at: usize, little: &[u8]| bytes[at..at + little.len()].copy_from_slice(little);
        put(0, &348i32.to_le_bytes());
        put(344, b"n+1\0");
        [3, side as i16, side as i16, side as i16]
            .iter()
            .enumerate()
            .for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
        put(70, &2i16.to_le_bytes());
        put(108, &352.0f32.to_le_bytes());
        [80, 84, 88].iter().for_each(|at| put(*at, &1.0f32.to_le_bytes()));
        bytes.extend((0..side.pow(3)).map(|at| ((at + at / side + at / side / side) % 2) as u8));
        bytes
    }

    #[test]
    fn label_maps_are_limited_for_all_shapes_of_a_scene_together() {
        let files = SentFiles::from(["a.nii", "b.nii"].map(|name| (name.to_owned(), checkered(8))));
        // Room for one map and half another, and its 256 voxels of six quads and half of them once more.
        let mut room = Room { voxels: 768, quads: 2304, numbers: 0, reads: 0 };
        let mut maps = BTreeMap::new();
        let mut read = |file, labels: &[u16]| read_labels(&Files::Sent(&files), file, labels, &mut maps, &mut room);
        assert_eq!(read("a.nii", &[1]).unwrap().triangles.len(), 3072);
        let refused = read("a.nii", &[1, 1]).unwrap_err().to_string();
        assert!(refused.contains("768 quads"), "{refused}");
        let refused = read("b.nii", &[1]).unwrap_err().to_string();
        assert!(refused.contains("512 voxels are more than the limit of 256"), "{refused}");
    }

    #[test]
    fn a_scene_refers_to_no_more_files_than_it_may_have() {
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
        let files: SentFiles = (0..=MAX_READ).map(|index| (format!("{index}.obj"), corners.into())).collect();
        let mesh = |index: usize| format!("{{ mesh = {{ file = \"{index}.obj\", scale_m_per_unit = 0.1 }} }}");
        let named = |count: usize| format!("fixed = [{}]\n", (1..count).map(mesh).collect::<Vec<_>>().join(", "));
        let read = |count| from_text("x.toml", &(scene(&mesh(0)) + &named(count)), &files);
        assert!(read(MAX_READ).is_ok());
        assert!(matches!(read(MAX_READ + 1), Err(ReadError::TooManyFiles { limit: MAX_READ })));
    }
}
