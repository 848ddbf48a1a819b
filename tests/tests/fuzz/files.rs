//! Files that users give.

use std::collections::BTreeMap;

use kerf_physics::SoundScene;
use kerf_scenes::cost::Cost;
use kerf_scenes::error::ReadError;
use kerf_scenes::file::{SentFiles, from_text};

use super::{corpus, fuzz, inputs_of};
use crate::grpc::harness::BLOCK;

/// What a server does with a scene before it takes memory for it.
fn judge(scene: Result<SoundScene, ReadError>) {
    match scene {
        Ok(scene) => drop(Cost::of(&scene)),
        Err(refused) => assert!(!refused.to_string().is_empty()),
    }
}

#[test]
fn scene() {
    let mut texts = inputs_of("../server/scenes/builtin", ".toml");
    texts.push(BLOCK.into());
    fuzz("scene", &texts, |bytes| judge(from_text("fuzzed", &String::from_utf8_lossy(bytes), &SentFiles::new())));
}

/// A scene whose shape, or whose blade's edge, is in a file.
fn with_file(name: &str, bytes: &[u8]) -> Result<SoundScene, ReadError> {
    let shape = match name.contains("nii") || name.contains("nrrd") {
        true => format!("shape = {{ label_map = {{ file = \"{name}\" }} }}"),
        false => format!("shape = {{ mesh = {{ file = \"{name}\", scale_m_per_unit = 1.0 }} }}"),
    };
    let text = BLOCK.replace("shape = { box = { min_m = [-0.01, -0.01, -0.01], max_m = [0.01, 0.01, 0.01] } }", &shape);
    assert_ne!(text, BLOCK);
    from_text("fuzzed", &text, &BTreeMap::from([(name.to_owned(), bytes.to_vec())]))
}

fn shapes(extension: &str) {
    let name = format!("shape{extension}");
    let corpus = corpus(extension);
    corpus.iter().for_each(|file| drop(with_file(&name, file).expect("the corpus is read")));
    fuzz(extension.trim_start_matches('.'), &corpus, |bytes| judge(with_file(&name, bytes)));
}

#[test]
fn stl() {
    shapes(".stl");
}

#[test]
fn obj() {
    shapes(".obj");
}

#[test]
fn ply() {
    shapes(".ply");
}

#[test]
fn vtu() {
    shapes(".vtu");
}

#[test]
fn vtp() {
    shapes(".vtp");
}

#[test]
fn msh() {
    shapes(".msh");
}

#[test]
fn nifti() {
    shapes(".nii");
}

#[test]
fn nrrd() {
    shapes(".nrrd");
}

#[test]
fn edge() {
    let edge = "shape = { blade = { width_m = 0.02, height_m = 0.01, edge = { file = { file = \"edge.csv\", scale_m_per_unit = 1.0 } } } }";
    let text = BLOCK.replacen("shape = { blade = { width_m = 0.02, height_m = 0.01 } }", edge, 1);
    fuzz("edge", &corpus(".edge.csv"), |bytes| {
        judge(from_text("fuzzed", &text, &BTreeMap::from([("edge.csv".to_owned(), bytes.to_vec())])));
    });
}

#[test]
fn script() {
    let tools = ["left".to_owned(), "right".to_owned()];
    fuzz("script", &corpus(".script.csv"), |bytes| {
        for track in kerf_script::read(bytes, &tools).unwrap_or_default() {
            let track = track.lifted_at_end();
            let times_s = [0.0, 0.5 * track.end_s(), track.end_s()];
            assert!(times_s.iter().filter_map(|time_s| track.at(*time_s)).all(|at| at.pose.position_m.x.is_finite()));
            assert!(track.max_speed_m_per_s() >= 0.0);
        }
    });
}
