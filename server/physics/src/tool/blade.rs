//! The blade's shape.
