//! Where the scenes of sessions come from: a name that the server knows, or text that a client sends.

use kerf_physics::scene::ShapeDesc;
use kerf_physics::{Scene, SceneDesc};

use kerf_session::catalog;

use crate::status::RequestError;

/// Names and descriptions of the scenes that the server knows, by name.
pub fn list() -> Vec<(String, String)> {
    let described = |name: &str| catalog::builtin(name).map(|scene| (name.to_owned(), scene.desc.description)).ok();
    catalog::builtin_names().iter().filter_map(|name| described(name)).collect()
}

/// The built-in scene of this name. Paths are not names: a client's word reaches no file.
pub fn by_name(name: &str) -> Result<Scene, RequestError> {
    catalog::builtin(name).map_err(|_| RequestError::NoScene { name: name.chars().take(64).collect() })
}

/// A scene from a client's text. It may not name files: they would be the server's.
pub fn from_text(text: &str, max_bytes: usize) -> Result<Scene, RequestError> {
    let refuse = |message: String| RequestError::SceneText { message };
    if text.len() > max_bytes {
        return Err(refuse(format!("scene_toml: {} bytes, at most {max_bytes} (max_scene_bytes)", text.len())));
    }
    let desc = SceneDesc::from_toml("scene_toml", text).map_err(|error| refuse(error.to_string()))?;
    desc.validate().map_err(|error| refuse(format!("scene_toml: {error}")))?;
    match desc.objects.iter().position(|object| object.shapes().any(is_mesh)) {
        Some(index) => Err(refuse(format!("objects[{index}]: a scene sent as text may not refer to files"))),
        None => Ok(Scene { desc, meshes: Default::default() }),
    }
}

fn is_mesh(shape: &ShapeDesc) -> bool {
    match shape {
        ShapeDesc::SmoothUnion { parts, .. } => parts.iter().any(is_mesh),
        _ => shape.mesh().is_some(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(shape: &str) -> String {
        let material = "material = { young_modulus_pa = 1e3, poisson_ratio = 0.4 }";
        format!("version = 1\nname = \"x\"\n[[objects]]\nname = \"x\"\nresolution = 8\nshape = {shape}\n{material}\n")
    }

    #[test]
    fn a_scene_sent_as_text_may_not_name_files_anywhere() {
        let mesh = r#"{ mesh = { file = "/etc/passwd", scale_m_per_unit = 1.0 } }"#;
        assert!(matches!(from_text(&scene(mesh), 1 << 20), Err(RequestError::SceneText { .. })));
        let labels = r#"{ label_map = { file = "/etc/passwd" } }"#;
        assert!(matches!(from_text(&scene(labels), 1 << 20), Err(RequestError::SceneText { .. })));
        let union = format!("{{ smooth_union = {{ blend_m = 0.0, parts = [{mesh}] }} }}");
        assert!(matches!(from_text(&scene(&union), 1 << 20), Err(RequestError::SceneText { .. })));
        let finer = scene("{ sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }")
            + &format!("finer = [{{ shape = {mesh}, level = 1 }}]\n");
        assert!(matches!(from_text(&finer, 1 << 20), Err(RequestError::SceneText { .. })));
        assert!(from_text(&scene("{ sphere = { center_m = [0.0, 0.0, 0.0], radius_m = 0.1 } }"), 1 << 20).is_ok());
    }

    #[test]
    fn a_scene_that_is_too_large_is_refused_before_it_is_read() {
        assert!(matches!(from_text(&"x".repeat(11), 10), Err(RequestError::SceneText { .. })));
    }
}
