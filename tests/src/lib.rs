//! Tests that run the whole system, see the files beside this crate's `src`; the cases that verify the
//! physics against analytic and independent results; those that drive it to the ends of its ranges; what
//! its steps cost; random strokes by the thousand; one published experiment; and the readers that are fuzzed.

pub mod dicing;
pub mod experiment;
pub mod extremes;
pub mod performance;
pub mod readers;
pub mod rows;
pub mod shared;
pub mod strokes;
pub mod verification;
