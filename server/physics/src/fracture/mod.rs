//! Fracture: the force-capped front along a blade's edge and the links it parts.
//!
//! A blade's front is a chain of markers, one to a piece of the edge (`front`, `marker`). A marker in
//! contact pushes, through springs (`springs`), on a point of the material (`anchor`) that it
//! found where the edge came in through the surface (`entry`); what a strained body adds to its drive, or takes
//! off it, is sampled around the front (`drive`, `release`). What the point advances is booked
//! (`book`), and the links across the strip that the chain has swept part (`sweep`). Where the cut stands beyond them the
//! body keeps (`crack`), so that it goes on from there under whatever drives it next. By the other rule
//! (`link_energy`) a point advances link by link, where the link ahead holds enough energy.
//!
//! What constants are said to move was measured by halving and doubling each on two strokes. One is the stroke of the
//! built-in `liver`. The other cuts a soft block that is drawn apart (E 20 kPa, Gc 20 J/m^2, a stiffening of 10, voxels of
//! 2.5 mm, level 1): a wedge comes down, slices along and back, and is drawn out. The mean force is that while it cuts.

mod anchor;
mod book;
pub mod cohesive;
mod compliance;
mod crack;
mod drive;
mod entry;
mod front;
mod ligament;
mod link_energy;
mod marker;
pub mod release;
mod springs;
mod sweep;
pub mod tear;
mod travel;
mod way_in;

pub use book::FrontBook;
pub use crack::Crack;
pub use front::{BladeMotion, Front};
pub use marker::Tissue;

/// How often what a body sets free is sampled at one place ahead of blades, s: not every one of shorter steps does.
/// Ours: two steps of 1 kHz, in which a front of 0.1 m/s goes on by a tenth of a voxel. Half or twice of it moves the
/// force by 0.2 %, rms.
const SAMPLE_EVERY_S: f64 = 2e-3;

/// Whether the step of this number samples the drive at one place of each front.
#[must_use]
pub fn samples_drive(step: u64, dt_s: f64) -> bool {
    step.is_multiple_of((SAMPLE_EVERY_S / dt_s).round().max(1.0) as u64)
}
