//! Tests that run the whole system, see the files beside this crate's `src`; the cases that verify the
//! physics against analytic and independent results; those that drive it to the ends of its ranges; what
//! its steps cost; and random strokes by the thousand.

pub mod extremes;
pub mod figure;
pub mod performance;
pub mod strokes;
pub mod verification;
