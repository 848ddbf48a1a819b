//! One walk over plain data, derived with `serde`: it hashes, writes and compares. What a type derives is walked by all
//! of them; what it skips follows from the rest and is skipped by all of them.
//!
//! Numbers are taken by their bits, at their own width, in the order of the fields. Nothing names a field in the file:
//! it is read by the program that wrote it, or refused.

mod decode;
mod difference;
mod encode;
mod hash;
mod kept;
mod parts;
#[cfg(test)]
pub mod places;
#[cfg(test)]
mod tests;
mod walker;

pub use decode::decode;
pub use difference::difference;
pub use encode::{checksum, encode};
pub use hash::hash;
pub use kept::{Kept, KeptHash, KeptView};
pub use parts::parts;

use std::fmt::Display;

/// What comes by on a walk.
trait Visitor {
    /// Whether of what keeps its hash only that is visited.
    const KEPT_BY_HASH: bool;

    /// A number, by its bits, so many bytes wide.
    fn word(&mut self, value: u64, bytes: usize);
    /// A field, an element or an entry begins.
    fn enter(&mut self, _place: Place) {}
    /// And ends.
    fn leave(&mut self) {}
}

/// A place within what is walked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Field(&'static str),
    Element(usize),
}

/// Why plain data cannot be walked or read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub(crate) struct WalkError(String);

impl WalkError {
    /// With these words.
    #[must_use]
    pub fn new(message: String) -> Self {
        Self(message)
    }
}

impl serde::ser::Error for WalkError {
    fn custom<T: Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

impl serde::de::Error for WalkError {
    fn custom<T: Display>(message: T) -> Self {
        Self(message.to_string())
    }
}
