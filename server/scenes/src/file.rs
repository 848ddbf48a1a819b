//! Scenes from files, with the files that they name; and from text, which may name none.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io;
use std::path::{Path, PathBuf};

use kerf_physics::scene::{EdgeDesc, Meshes, ShapeDesc, ToolShapeDesc, TriangleMesh};
use kerf_physics::{Scene, SceneDesc, SceneError};

use crate::error::ReadError;
use crate::nifti::LabelMap;
use crate::{edge_file, label_surface, mesh_file};

/// Largest scene file, bytes: a thousand times a large scene written by hand.
pub const MAX_SCENE_BYTES: u64 = 4 << 20;
/// Largest mesh or label map file, bytes: some five million triangles in binary.
pub const MAX_MESH_BYTES: u64 = 256 << 20;
/// Largest file of an edge's points, bytes: more than as many points as an edge may have.
pub const MAX_EDGE_BYTES: u64 = 1 << 20;

/// A scene whose values are not judged yet, with the text that it stands in.
#[derive(Debug)]
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    name: String,
    text: String,
}

impl Opened {
    /// The scene of a text that names no files.
    pub(crate) fn of_text(name: &str, text: &str) -> Result<Self, SceneError> {
        let scene = Scene { desc: SceneDesc::from_toml(name, text)?, meshes: Meshes::new() };
        Ok(Self { scene, name: name.to_owned(), text: text.to_owned() })
    }

    /// A problem or a warning with its place in the text.
    #[must_use]
    pub fn placed(&self, problem: SceneError) -> SceneError {
        problem.placed(&self.name, &self.text)
    }

    /// Problems as an error, each with its place in the text.
    #[must_use]
    pub fn refused(&self, problems: Vec<SceneError>) -> ReadError {
        let problems = problems.into_iter().map(|problem| self.placed(problem)).collect();
        ReadError::Invalid { name: self.name.clone(), problems }
    }

    /// The scene, if all its values are supported.
    ///
    /// # Errors
    /// Every value that is not.
    pub fn sound(self) -> Result<Scene, ReadError> {
        let problems = self.scene.problems();
        if problems.is_empty() { Ok(self.scene) } else { Err(self.refused(problems)) }
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
    let mut opened = Opened::of_text(&name, text)?;
    let Scene { desc, meshes } = &mut opened.scene;
    let folder = path.parent().unwrap_or(Path::new(""));
    read_edges(desc, folder)?;
    let mut label_maps = BTreeMap::new();
    for shape in desc.objects.iter().flat_map(|object| object.shapes()) {
        let Some(mesh) = shape.mesh().filter(|mesh| !meshes.contains_key(&mesh.key)) else { continue };
        let read = match shape {
            ShapeDesc::LabelMap { file, labels, .. } => read_labels(&folder.join(file), labels, &mut label_maps)?,
            _ => read_mesh(&folder.join(&mesh.key))?,
        };
        meshes.insert(mesh.key, read);
    }
    Ok(opened)
}

/// A scene from a text that is called `name` in what is wrong with it. It may not name files: they would be
/// those of the machine that reads it.
///
/// # Errors
/// What is wrong with the text, the first object that names a file, or every value that is not supported.
pub fn from_text(name: &str, text: &str) -> Result<Scene, ReadError> {
    let opened = Opened::of_text(name, text)?;
    match opened.scene.desc.objects.iter().position(|object| object.shapes().any(names_file)) {
        Some(object) => Err(ReadError::NamesFile { object }),
        None => opened.sound(),
    }
}

fn names_file(shape: &ShapeDesc) -> bool {
    match shape {
        ShapeDesc::SmoothUnion { parts, .. } => parts.iter().any(names_file),
        _ => shape.mesh().is_some(),
    }
}

/// Reads one mesh file.
///
/// # Errors
/// The file cannot be read, is too large, or is not the mesh that its extension says.
pub fn read_mesh(path: &Path) -> Result<TriangleMesh, ReadError> {
    let bytes = read(path, MAX_MESH_BYTES)?;
    mesh_file::parse(path, &bytes).map_err(|message| ReadError::Mesh { path: path.to_owned(), message })
}

/// Puts the points in the place of each edge that names a file: they are few, and the scene is whole then.
fn read_edges(desc: &mut SceneDesc, folder: &Path) -> Result<(), ReadError> {
    for tool in &mut desc.tools {
        let ToolShapeDesc::Blade(blade) = &mut tool.shape else { continue };
        if let EdgeDesc::File { file, scale_m_per_unit } = &blade.edge {
            let path = folder.join(file);
            let bytes = read(&path, MAX_EDGE_BYTES)?;
            let points_m = edge_file::parse(&bytes, *scale_m_per_unit)
                .map_err(|message| ReadError::Edge { path: path.clone(), message })?;
            blade.edge = EdgeDesc::Polyline { points_m };
        }
    }
    Ok(())
}

/// The surface of some labels of a map, which is read where it is not among those read before.
fn read_labels(
    path: &Path,
    labels: &[u16],
    read_before: &mut BTreeMap<PathBuf, LabelMap>,
) -> Result<TriangleMesh, ReadError> {
    let wrong = |message| ReadError::Mesh { path: path.to_owned(), message };
    let map = match read_before.entry(path.to_owned()) {
        Entry::Occupied(known) => known.into_mut(),
        Entry::Vacant(new) => new.insert(LabelMap::parse(&read(path, MAX_MESH_BYTES)?).map_err(wrong)?),
    };
    label_surface::surface(map, labels).map_err(wrong)
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
    fn a_scene_sent_as_text_may_not_name_files_anywhere() {
        let mesh = r#"{ mesh = { file = "/etc/passwd", scale_m_per_unit = 1.0 } }"#;
        assert!(matches!(from_text("x.toml", &scene(mesh)), Err(ReadError::NamesFile { object: 0 })));
        let labels = r#"{ label_map = { file = "/etc/passwd" } }"#;
        assert!(matches!(from_text("x.toml", &scene(labels)), Err(ReadError::NamesFile { object: 0 })));
        let union = format!("{{ smooth_union = {{ blend_m = 0.0, parts = [{mesh}] }} }}");
        assert!(matches!(from_text("x.toml", &scene(&union)), Err(ReadError::NamesFile { object: 0 })));
        let finer = scene("{ sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }")
            + &format!("finer = [{{ shape = {mesh}, level = 1 }}]\n");
        assert!(matches!(from_text("x.toml", &finer), Err(ReadError::NamesFile { object: 0 })));
        assert!(from_text("x.toml", &scene("{ sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }")).is_ok());
    }
}
