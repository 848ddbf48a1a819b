//! The scenes that come with the program, and scenes from files.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io;
use std::path::{Path, PathBuf};

use kerf_physics::scene::{EdgeDesc, Meshes, ShapeDesc, ToolShapeDesc, TriangleMesh};
use kerf_physics::{Scene, SceneDesc, SceneError};

use crate::nifti::LabelMap;
use crate::{edge_file, label_surface, mesh_file};

/// Largest scene file, bytes: a thousand times a large scene written by hand.
pub const MAX_SCENE_BYTES: u64 = 4 << 20;
/// Largest mesh or label map file, bytes: some five million triangles in binary.
pub const MAX_MESH_BYTES: u64 = 256 << 20;

/// Largest file of an edge's points, bytes: more than as many points as an edge may have.
pub const MAX_EDGE_BYTES: u64 = 1 << 20;

const BUILTIN: [(&str, &str); 17] = [
    ("jelly", include_str!("../scenes/jelly.toml")),
    ("tofu", include_str!("../scenes/tofu.toml")),
    ("rubber", include_str!("../scenes/rubber.toml")),
    ("cuboid", include_str!("../scenes/cuboid.toml")),
    ("cuboid-polyline", include_str!("../scenes/cuboid-polyline.toml")),
    ("cuboid-sine", include_str!("../scenes/cuboid-sine.toml")),
    ("gummy-bear", include_str!("../scenes/gummy-bear.toml")),
    ("liver", include_str!("../scenes/liver.toml")),
    ("liver-tissue", include_str!("../scenes/liver-tissue.toml")),
    ("hepatectomy", include_str!("../scenes/hepatectomy.toml")),
    ("two-organs", include_str!("../scenes/two-organs.toml")),
    ("skin", include_str!("../scenes/skin.toml")),
    ("gelatine", include_str!("../scenes/gelatine.toml")),
    ("potato", include_str!("../scenes/potato.toml")),
    ("cucumber", include_str!("../scenes/cucumber.toml")),
    ("apple", include_str!("../scenes/apple.toml")),
    ("pressed-block", include_str!("../scenes/pressed-block.toml")),
];

/// Why a scene cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum CatalogError {
    /// Neither a built-in scene nor a file.
    #[error("`{name}` is neither a file nor one of the built-in scenes: {}", builtin_names().join(", "))]
    NotFound {
        /// What was asked for.
        name: String,
    },
    /// A file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file is larger than the limit.
    #[error("{}: {bytes} bytes are more than the limit of {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// [`MAX_SCENE_BYTES`], [`MAX_MESH_BYTES`] or [`MAX_EDGE_BYTES`].
        limit: u64,
    },
    /// A file does not hold the points of an edge.
    #[error("{}: {message}", path.display())]
    Edge {
        /// The file.
        path: PathBuf,
        /// The line and what is wrong with it.
        message: String,
    },
    /// A file does not hold the mesh or the labels that it should.
    #[error("{}: {message}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// The file is not the TOML of a scene.
    #[error(transparent)]
    Parse(#[from] SceneError),
    /// Values that are not supported.
    #[error("{name}: {}", problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Invalid {
        /// Built-in name or path.
        name: String,
        /// All of them; at least one.
        problems: Vec<SceneError>,
    },
}

/// Names of the built-in scenes.
#[must_use]
pub fn builtin_names() -> [&'static str; BUILTIN.len()] {
    BUILTIN.map(|(name, _)| name)
}

/// What the paper's Table 1 says of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PaperCounts {
    /// Fine voxels.
    pub voxels: u32,
    /// Composite elements.
    pub composite_elements: u32,
}

/// The paper's counts for a built-in scene that the paper has.
#[must_use]
pub fn paper_counts(name: &str) -> Option<PaperCounts> {
    let (voxels, composite_elements) = match name {
        "gummy-bear" => (51_034, 899),
        "jelly" | "tofu" | "rubber" => (12_676, 240),
        "cuboid" | "cuboid-polyline" | "cuboid-sine" => (59_248, 144),
        "liver" => (30_360, 559),
        _ => return None,
    };
    Some(PaperCounts { voxels, composite_elements })
}

/// A built-in scene. The only way to a scene that touches no file: names from the network go here.
///
/// # Errors
/// [`CatalogError::NotFound`] for any other name.
pub fn builtin(name: &str) -> Result<Scene, CatalogError> {
    let found = BUILTIN.iter().find(|(known, _)| *known == name);
    let (name, text) = found.ok_or_else(|| CatalogError::NotFound { name: name.to_owned() })?;
    sound(name, Scene { desc: SceneDesc::from_toml(&format!("{name}.toml"), text)?, meshes: Meshes::new() })
}

/// A scene by its built-in name or the path of its file, with its meshes, ready for a world.
///
/// # Errors
/// The first file that cannot be had or read, or every value that is not supported.
pub fn load(name_or_path: &str) -> Result<Scene, CatalogError> {
    if builtin_names().contains(&name_or_path) {
        return builtin(name_or_path);
    }
    sound(name_or_path, open(Path::new(name_or_path))?)
}

/// A scene from a file with its meshes, edges from files as the polylines they are; its values are not
/// judged.
///
/// # Errors
/// The first file that cannot be had or read.
pub fn open(path: &Path) -> Result<Scene, CatalogError> {
    let name = path.display().to_string();
    if !path.is_file() {
        return Err(CatalogError::NotFound { name });
    }
    let text = String::from_utf8(read(path, MAX_SCENE_BYTES)?)
        .map_err(|e| CatalogError::Read { path: path.to_owned(), source: io::Error::other(e) })?;
    let mut desc = SceneDesc::from_toml(&name, &text)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    read_edges(&mut desc, folder)?;
    let mut meshes = Meshes::new();
    let mut label_maps = BTreeMap::new();
    for shape in desc.objects.iter().flat_map(|object| object.shapes()) {
        let Some(mesh) = shape.mesh().filter(|mesh| !meshes.contains_key(&mesh.key)) else { continue };
        let read = match shape {
            ShapeDesc::LabelMap { file, labels, .. } => read_labels(&folder.join(file), labels, &mut label_maps)?,
            _ => read_mesh(&folder.join(&mesh.key))?,
        };
        meshes.insert(mesh.key, read);
    }
    Ok(Scene { desc, meshes })
}

/// Reads one mesh file.
///
/// # Errors
/// The file cannot be read, is too large, or is not the mesh that its extension says.
pub fn read_mesh(path: &Path) -> Result<TriangleMesh, CatalogError> {
    let bytes = read(path, MAX_MESH_BYTES)?;
    mesh_file::parse(path, &bytes).map_err(|message| CatalogError::Mesh { path: path.to_owned(), message })
}

/// Puts the points in the place of each edge that names a file: they are few, and the scene is whole then.
fn read_edges(desc: &mut SceneDesc, folder: &Path) -> Result<(), CatalogError> {
    for tool in &mut desc.tools {
        let ToolShapeDesc::Blade(blade) = &mut tool.shape else { continue };
        if let EdgeDesc::File { file, scale_m_per_unit } = &blade.edge {
            let path = folder.join(file);
            let bytes = read(&path, MAX_EDGE_BYTES)?;
            let points_m = edge_file::parse(&bytes, *scale_m_per_unit)
                .map_err(|message| CatalogError::Edge { path: path.clone(), message })?;
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
) -> Result<TriangleMesh, CatalogError> {
    let wrong = |message| CatalogError::Mesh { path: path.to_owned(), message };
    let map = match read_before.entry(path.to_owned()) {
        Entry::Occupied(known) => known.into_mut(),
        Entry::Vacant(new) => new.insert(LabelMap::parse(&read(path, MAX_MESH_BYTES)?).map_err(wrong)?),
    };
    label_surface::surface(map, labels).map_err(wrong)
}

fn sound(name: &str, scene: Scene) -> Result<Scene, CatalogError> {
    let problems = scene.problems();
    if problems.is_empty() { Ok(scene) } else { Err(CatalogError::Invalid { name: name.to_owned(), problems }) }
}

fn read(path: &Path, limit: u64) -> Result<Vec<u8>, CatalogError> {
    let failed = |source| CatalogError::Read { path: path.to_owned(), source };
    let bytes = std::fs::metadata(path).map_err(failed)?.len();
    if bytes > limit {
        return Err(CatalogError::TooLarge { path: path.to_owned(), bytes, limit });
    }
    std::fs::read(path).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_builtin_scene_is_sound_and_bears_its_name() {
        for name in builtin_names() {
            let scene = load(name).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(scene.desc.name, name);
            assert_eq!(scene.desc.rate_hz, 1000.0);
            assert_eq!(scene.desc.tools.is_empty(), name == "pressed-block", "{name}");
            assert!(!scene.desc.probes.is_empty() && !scene.desc.description.is_empty(), "{name}");
        }
    }

    #[test]
    fn every_builtin_scene_can_be_solved_at_every_finer_level() {
        for name in builtin_names() {
            let mut scene = load(name).unwrap();
            for level in 0..=scene.desc.objects[0].level {
                scene.desc.objects[0].level = level;
                assert_eq!(scene.problems(), [], "{name} at level {level}");
            }
        }
    }

    #[test]
    fn an_edge_from_a_file_is_in_the_scene_once_it_is_loaded() {
        let folder = std::env::temp_dir().join(format!("kerf-edge-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let jelly = BUILTIN.iter().find(|(name, _)| *name == "jelly").unwrap().1;
        let blade = "{ blade = { width_m = 0.04, height_m = 0.05, edge = { file = { file = \"teeth.csv\", \
                     scale_m_per_unit = 1e-3 } } } }";
        let tool =
            |line: &str| if line.starts_with("shape = { blade") { format!("shape = {blade}") } else { line.into() };
        let path = folder.join("jelly.toml");
        std::fs::write(&path, jelly.lines().map(|line| tool(line) + "\n").collect::<String>()).unwrap();
        let missing = open(&path).unwrap_err().to_string();
        std::fs::write(folder.join("teeth.csv"), "-20,0,-2\n0,0,2\n20,0,-2\n").unwrap();
        let scene = load(&path.display().to_string());
        std::fs::write(folder.join("teeth.csv"), "-20,0,-2\n0,0\n").unwrap();
        let broken = open(&path).unwrap_err().to_string();
        std::fs::remove_dir_all(&folder).unwrap();
        let ToolShapeDesc::Blade(blade) = &scene.unwrap().desc.tools[0].shape else { panic!("a blade") };
        let points_m = [[-20.0, 0.0, -2.0], [0.0, 0.0, 2.0], [20.0, 0.0, -2.0]].map(|p| p.map(|x: f64| x * 1e-3));
        assert_eq!(blade.edge, EdgeDesc::Polyline { points_m: points_m.to_vec() });
        assert!(missing.contains("teeth.csv"), "{missing}");
        assert!(broken.contains("teeth.csv: line 2"), "{broken}");
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let message = load("livre").unwrap_err().to_string();
        assert!(message.contains("`livre`") && message.contains("liver-tissue"), "{message}");
    }

    #[test]
    fn names_from_outside_reach_no_file() {
        assert!(matches!(builtin("/etc/passwd"), Err(CatalogError::NotFound { .. })));
    }
}
