//! Files that users give.

use std::collections::BTreeMap;

use kerf_physics::SoundScene;
use kerf_scenes::cost::Cost;
use kerf_scenes::error::ReadError;
use kerf_scenes::file::{SentFiles, from_text};

use super::{BLOCK, Reader, corpus, inputs_of};

/// A scene's text.
pub const SCENE: Reader = Reader {
    name: "scene",
    seeds: || {
        let mut texts = inputs_of("../server/scenes/builtin", ".toml");
        texts.push(BLOCK.into());
        texts
    },
    read: |bytes| judge(from_text("fuzzed", &String::from_utf8_lossy(bytes), &SentFiles::new())),
};

/// A file that a scene's shape is in.
macro_rules! shape {
    ($name:literal, $extension:literal) => {
        Reader {
            name: $name,
            seeds: || corpus($extension),
            read: |bytes| judge(with_file(concat!("shape", $extension), bytes)),
        }
    };
}

/// Meshes of triangles.
pub const STL: Reader = shape!("stl", ".stl");
/// As Wavefront has them.
pub const OBJ: Reader = shape!("obj", ".obj");
/// As Stanford has them.
pub const PLY: Reader = shape!("ply", ".ply");
/// VTK's unstructured grids.
pub const VTU: Reader = shape!("vtu", ".vtu");
/// VTK's surfaces.
pub const VTP: Reader = shape!("vtp", ".vtp");
/// Gmsh's meshes.
pub const MSH: Reader = shape!("msh", ".msh");
/// Label maps.
pub const NIFTI: Reader = shape!("nifti", ".nii");
/// The same, as Teem has them.
pub const NRRD: Reader = shape!("nrrd", ".nrrd");

/// A blade's edge.
pub const EDGE: Reader = Reader {
    name: "edge",
    seeds: || corpus(".edge.csv"),
    read: |bytes| {
        let edge = "shape = { blade = { width_m = 0.02, height_m = 0.01, edge = { file = { file = \"edge.csv\", scale_m_per_unit = 1.0 } } } }";
        let text = BLOCK.replacen("shape = { blade = { width_m = 0.02, height_m = 0.01 } }", edge, 1);
        judge(from_text("fuzzed", &text, &BTreeMap::from([("edge.csv".to_owned(), bytes.to_vec())])));
    },
};

/// A script of tools' motions.
pub const SCRIPT: Reader = Reader {
    name: "script",
    seeds: || corpus(".script.csv"),
    read: |bytes| {
        let tools = ["left".to_owned(), "right".to_owned()];
        for track in kerf_script::read(bytes, &tools).unwrap_or_default() {
            let track = track.lifted_at_end();
            let times_s = [0.0, 0.5 * track.end_s(), track.end_s()];
            assert!(times_s.iter().filter_map(|time_s| track.at(*time_s)).all(|at| at.pose.position_m.x.is_finite()));
            assert!(track.max_speed_m_per_s() >= 0.0);
        }
    },
};

/// What a server does with a scene before it takes memory for it.
fn judge(scene: Result<SoundScene, ReadError>) {
    match scene {
        Ok(scene) => drop(Cost::of(&scene)),
        Err(refused) => assert!(!refused.to_string().is_empty()),
    }
}

/// A scene whose shape is in a file.
///
/// # Errors
/// The file is no shape.
pub fn with_file(name: &str, bytes: &[u8]) -> Result<SoundScene, ReadError> {
    let shape = match name.contains("nii") || name.contains("nrrd") {
        true => format!("shape = {{ label_map = {{ file = \"{name}\" }} }}"),
        false => format!("shape = {{ mesh = {{ file = \"{name}\", scale_m_per_unit = 1.0 }} }}"),
    };
    let text = BLOCK.replace("shape = { box = { min_m = [-0.01, -0.01, -0.01], max_m = [0.01, 0.01, 0.01] } }", &shape);
    assert_ne!(text, BLOCK);
    from_text("fuzzed", &text, &BTreeMap::from([(name.to_owned(), bytes.to_vec())]))
}
