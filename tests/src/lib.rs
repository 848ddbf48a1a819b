//! Tests that run the whole system, see the files beside this crate's `src`; and the cases that verify
//! the physics against analytic and independent results.

pub mod verification;
