//! Sessions: one module a subject.

mod governor;
mod points;
mod session;
mod unwatched;
