//! Readers of files and messages that strangers give, as fuzzing calls them: each with inputs that are sound. `tests/tests/fuzz` changes
//! these at random; `tests/fuzz` does so with feedback on the code that they reach.
//!
//! A reader refuses what is no input of its in words. It neither panics, nor hangs, nor takes memory without bounds.

pub mod files;
pub mod messages;
pub mod states;

use std::path::{Path, PathBuf};

use kerf_physics::{Scene, SoundScene};
use tokio::runtime::Runtime;

/// The scene that sessions are tested on.
pub const BLOCK: &str = include_str!("../../../server/session/tests/block.toml");

/// The folder that sound inputs are written to, if a coverage-guided run is to begin with them.
const SEEDS: &str = "FUZZ_SEEDS";

/// A reader.
pub struct Reader {
    /// What it reads.
    pub name: &'static str,
    /// Inputs that fuzzing begins with.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Reads an input; it panics where the reader has a fault.
    pub read: fn(&[u8]),
}

impl Reader {
    /// Writes the inputs that fuzzing begins with to the folder that `FUZZ_SEEDS` names, if it is set.
    ///
    /// # Panics
    /// They cannot be written.
    pub fn write_seeds(&self) {
        let Some(folder) = std::env::var_os(SEEDS).map(PathBuf::from) else { return };
        std::fs::create_dir_all(&folder).expect("a folder for inputs");
        for (index, seed) in (self.seeds)().iter().enumerate() {
            std::fs::write(folder.join(index.to_string()), seed).expect("a place for inputs");
        }
    }
}

/// That scene, judged.
fn block() -> SoundScene {
    let scene = Scene { desc: toml::from_str(BLOCK).expect("a scene"), meshes: Default::default() };
    scene.judge().expect("a sound scene")
}

/// What servers and sessions that are fuzzed run on.
///
/// # Panics
/// There are no threads.
#[must_use]
pub fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(1).build().expect("a runtime")
}

/// The files of `tests/corpus` whose names end so.
#[must_use]
pub fn corpus(extension: &str) -> Vec<Vec<u8>> {
    inputs_of("corpus", extension)
}

/// The files of a folder whose names end so; the folder as `tests` has it.
///
/// # Panics
/// There are none, or they cannot be read.
#[must_use]
pub fn inputs_of(folder: &str, extension: &str) -> Vec<Vec<u8>> {
    paths_of(folder, extension).iter().map(|path| std::fs::read(path).expect("readable")).collect()
}

/// Where these files are.
///
/// # Panics
/// There are none.
#[must_use]
pub fn paths_of(folder: &str, extension: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut paths: Vec<_> = entries.filter(|path| path.to_string_lossy().ends_with(extension)).collect();
    paths.sort();
    assert!(!paths.is_empty(), "no {extension} there");
    paths
}
