//! The scenes that come with the program.

use std::path::Path;

use kerf_physics::SoundScene;

use crate::builtin::BUILTIN;
use crate::error::ReadError;
use crate::file::{self, Opened};

pub use crate::builtin::builtin_names;

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
/// [`ReadError::NotFound`] for any other name.
pub fn builtin(name: &str) -> Result<SoundScene, ReadError> {
    Ok(open_builtin(name)?.judge()?.0)
}

fn open_builtin(name: &str) -> Result<Opened, ReadError> {
    let found = BUILTIN.iter().find(|(known, _)| *known == name);
    let (name, text) = found.ok_or_else(|| ReadError::NotFound { name: name.to_owned() })?;
    Ok(Opened::of_text(&format!("{name}.toml"), text)?)
}

/// A scene by its built-in name or the path of its file, with its meshes, ready for a world.
///
/// # Errors
/// The first file that cannot be had or read, or every value that is not supported.
pub fn load(name_or_path: &str) -> Result<SoundScene, ReadError> {
    Ok(open(name_or_path)?.judge()?.0)
}

/// A scene by its built-in name or the path of its file, with its meshes; the values of a file are not judged.
///
/// # Errors
/// The first file that cannot be had or read.
pub fn open(name_or_path: &str) -> Result<Opened, ReadError> {
    match open_builtin(name_or_path) {
        Err(ReadError::NotFound { .. }) => file::open(Path::new(name_or_path)),
        found => found,
    }
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
            assert!(!scene.desc.tracked_points.is_empty() && !scene.desc.description.is_empty(), "{name}");
        }
    }

    #[test]
    fn every_builtin_scene_can_be_solved_at_every_finer_level() {
        for name in builtin_names() {
            let mut scene = load(name).unwrap().into_scene();
            for level in 0..=scene.desc.objects[0].level {
                scene.desc.objects[0].level = level;
                assert_eq!(scene.problems(), [], "{name} at level {level}");
            }
        }
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones_and_the_one_that_was_probably_meant() {
        let message = load("livre").unwrap_err().to_string();
        assert!(message.contains("`livre`") && message.contains("liver-tissue"), "{message}");
        assert!(message.ends_with("; did you mean `liver`?"), "{message}");
    }

    #[test]
    fn names_from_outside_reach_no_file() {
        assert!(matches!(builtin("/etc/passwd"), Err(ReadError::NotFound { .. })));
    }
}
