//! Sessions: one module a subject.

mod checkpoints;
mod session;
