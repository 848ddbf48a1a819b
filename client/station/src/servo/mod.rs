//! What is rendered, a thousand times a second.
//!
//! [`core::Core`] is the whole of it as a function of what it is given: it reads no clock, takes no lock, allocates
//! nothing and cannot fail. [`runner`] puts it behind a device. The guards stand in a file each, in the order in which a
//! force goes through them: [`fault`], [`recovery`], [`schedule`], [`coupling`], [`passivity`], [`limits`].

pub mod core;
pub mod coupling;
pub mod fault;
pub mod limits;
pub mod model;
pub mod passivity;
pub mod recovery;
pub mod runner;
pub mod schedule;

use self::model::Update;
pub use crate::mapping::Hand;

/// What the server said last.
#[derive(Clone, Copy, Debug)]
pub struct Newest<'a> {
    /// What it said.
    pub update: &'a Update,
    /// Time since it came in, s.
    pub age_s: f64,
    /// Time since the pose was taken that it answers, s; infinite where it answers none.
    pub pose_age_s: f64,
}
