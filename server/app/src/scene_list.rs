//! The scenes that clients create by name: those that come with the program and those of a folder.
//!
//! A client's word is compared with the names of what is there; it becomes no path.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use kerf_physics::{SceneDesc, SoundScene};
use kerf_scenes::{ReadError, catalog};

/// Most scenes of a folder that are listed.
const MAX_SCENES: usize = 1000;

/// A scene that can be created by name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its name.
    pub name: String,
    /// What it says of itself.
    pub description: String,
}

/// The scenes of a server. Texts are read once, those of the folder anew when they change.
pub struct SceneList {
    builtin: Vec<Listed>,
    folder: Option<PathBuf>,
    read: Mutex<BTreeMap<PathBuf, Known>>,
}

/// A file of the folder as it was when it was read.
#[derive(Clone)]
struct Known {
    written: Option<SystemTime>,
    bytes: u64,
    /// `None` where it is no scene.
    listed: Option<Listed>,
}

impl SceneList {
    /// The built-in scenes and those of a folder, if there is one.
    #[must_use]
    pub fn new(folder: Option<PathBuf>) -> Self {
        let listed = |name: &str| {
            let description = catalog::builtin(name).map(|scene| scene.desc.description.clone()).unwrap_or_default();
            Listed { name: name.into(), description }
        };
        let builtin = catalog::builtin_names().into_iter().map(listed).collect();
        Self { builtin, folder, read: Mutex::default() }
    }

    /// All of them: those of the folder by name, which somebody put there on purpose, then the built-in ones in their
    /// order. Reads what is new in the folder: not for threads that may not wait.
    #[must_use]
    pub fn list(&self) -> Vec<Listed> {
        let mut listed: Vec<_> = self.in_folder().into_iter().map(|(_, listed)| listed).collect();
        listed.sort_by(|a, b| a.name.cmp(&b.name));
        listed.extend(self.builtin.iter().cloned());
        listed
    }

    /// Reads the scene of this name, with the files that it refers to; `None` where there is none.
    ///
    /// # Errors
    /// The scene, or a file that it refers to, cannot be read or has values that are not supported.
    pub fn load(&self, name: &str) -> Option<Result<SoundScene, ReadError>> {
        if self.builtin.iter().any(|builtin| builtin.name == name) {
            return Some(catalog::builtin(name));
        }
        let (path, _) = self.in_folder().into_iter().find(|(_, listed)| listed.name == name)?;
        Some(catalog::load(&path.display().to_string()))
    }

    /// The scenes of the folder. A name of a built-in scene stays that scene's.
    fn in_folder(&self) -> Vec<(PathBuf, Listed)> {
        let entries = self.folder.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten();
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let texts = paths.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let mut found = Vec::new();
        for path in texts.take(MAX_SCENES) {
            let Ok(metadata) = std::fs::metadata(&path) else { continue };
            let (written, bytes) = (metadata.modified().ok(), metadata.len());
            let known = read.get(&path).filter(|known| (known.written, known.bytes) == (written, bytes)).cloned();
            let known = known.unwrap_or_else(|| {
                let known = Known { written, bytes, listed: describe(&path, bytes) };
                read.insert(path.clone(), known.clone());
                known
            });
            let is_new = |listed: &Listed| self.builtin.iter().all(|builtin| builtin.name != listed.name);
            found.extend(known.listed.filter(is_new).map(|listed| (path, listed)));
        }
        found
    }
}

/// What a file says of its scene.
fn describe(path: &std::path::Path, bytes: u64) -> Option<Listed> {
    let name = path.file_stem()?.to_str()?.to_owned();
    let text = (bytes <= kerf_scenes::file::MAX_SCENE_BYTES).then(|| std::fs::read_to_string(path).ok()).flatten()?;
    match SceneDesc::from_toml(&path.display().to_string(), &text) {
        Ok(desc) => Some(Listed { name, description: desc.description }),
        Err(error) => {
            tracing::warn!("scene_dir: {error}");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_of_a_folder_are_listed_beside_the_built_in_ones_and_read_anew_when_they_change() {
        let folder = tempfile::tempdir().unwrap();
        let block = include_str!("../../session/tests/block.toml");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("mine.toml", block);
        write("liver.toml", block);
        write("broken.toml", "no scene");
        write("mesh.obj", "v 0 0 0");
        let scenes = SceneList::new(Some(folder.path().into()));
        let names = || scenes.list().into_iter().map(|listed| listed.name).collect::<Vec<_>>();
        assert!(names().contains(&"mine".into()) && !names().contains(&"broken".into()));
        assert_eq!(names().len(), catalog::builtin_names().len() + 1);
        assert_eq!(names()[..2], ["mine", "liver-tissue"], "what was put there, then what a newcomer would choose");
        assert_eq!(scenes.load("mine").unwrap().unwrap().desc.name, "block");
        assert_eq!(scenes.load("liver").unwrap().unwrap().desc.name, "liver", "a built-in scene is not replaced");
        write("mine.toml", &format!("description = \"changed\"\n{block}"));
        assert!(scenes.list().iter().any(|listed| listed.name == "mine" && listed.description == "changed"));
        for word in ["../mine", "mine.toml", "/etc/passwd", "broken", ""] {
            assert!(scenes.load(word).is_none(), "{word}");
        }
    }
}
