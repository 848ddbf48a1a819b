//! Why a scene cannot be had.

use std::path::PathBuf;

use kerf_physics::SceneError;
use kerf_physics::scene::wording::did_you_mean;

use crate::builtin::builtin_names;

/// Why a scene cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// Neither a built-in scene nor a file.
    #[error(
        "`{name}` is neither a file nor one of the built-in scenes: {}{}",
        builtin_names().join(", "),
        did_you_mean(name, builtin_names())
    )]
    NotFound {
        /// What was asked for.
        name: String,
    },
    /// A file cannot be read.
    #[error("{}: {message}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// A file is larger than the limit.
    #[error("{}: {bytes} bytes are more than the limit of {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// That of its kind, as [`crate::file`] has them.
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
    /// A scene sent as text refers to a file that was not sent with it.
    #[error("{name}: the scene refers to this file, which was not sent with it")]
    NotSent {
        /// The file, as the scene names it.
        name: String,
    },
    /// A scene refers to more files than are read for one.
    #[error("shapes and edges of the scene refer to files more than {limit} times, which is the limit")]
    TooManyFiles {
        /// That limit.
        limit: usize,
    },
    /// Values that are not supported.
    #[error("{}", problems.iter().map(|problem| line(name, problem)).collect::<Vec<_>>().join("\n"))]
    Invalid {
        /// Built-in name or path, or what the text is called.
        name: String,
        /// All of them; at least one.
        problems: Vec<SceneError>,
    },
}

/// A problem with the file's name, which one that has a place tells itself.
fn line(name: &str, problem: &SceneError) -> String {
    match problem {
        SceneError::InFile { .. } => problem.to_string(),
        SceneError::Field { .. } => format!("{name}: {problem}"),
    }
}
