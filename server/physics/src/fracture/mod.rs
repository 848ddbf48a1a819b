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
pub use drive::is_due as is_drive_due;
pub use front::{BladeMotion, Front};
pub use marker::Tissue;
