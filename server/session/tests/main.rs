//! Sessions: one module a subject.

mod points;
mod session;
