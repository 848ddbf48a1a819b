//! Scripted tools: where each is over time, and the CSV that says so.
//!
//! Servers and clients read the same files and move tools between the rows in the same way. Deliberately absent:
//! what a pose does to tissue, and the wire.

mod csv;
mod pose;
mod track;

pub use csv::{ScriptError, read, tool_index};
pub use pose::{POSE_COLUMNS, Pose};
pub use track::{Key, Placement, Track};
