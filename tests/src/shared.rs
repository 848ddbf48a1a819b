//! Scanned meshes, which are not part of the project: `TEST_SHARED` names the folder that has them in `models/`.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

/// The variable. `make` sets it to `../shared` where that is a folder.
const FOLDER: &str = "TEST_SHARED";

/// Where a mesh is; `None`, and a line that says so, where no folder is named.
///
/// # Errors
/// A folder is named and the mesh is not in it.
pub fn model(file: &str) -> Result<Option<PathBuf>> {
    let Some(folder) = std::env::var_os(FOLDER).filter(|folder| !folder.is_empty()) else {
        println!("SKIPPED: {file}, as {FOLDER} names no folder");
        return Ok(None);
    };
    let path = Path::new(&folder).join("models").join(file);
    ensure!(path.is_file(), "{FOLDER} is set, but {} is no file", path.display());
    Ok(Some(path))
}
