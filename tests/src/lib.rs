//! Tests that run the whole system, see the files beside this crate's `src`; the cases that verify the
//! physics against analytic and independent results; and those that drive it to the ends of its ranges.

pub mod extremes;
pub mod verification;
