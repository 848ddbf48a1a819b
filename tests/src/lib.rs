//! Tests that run the whole system; see the files beside this one.

pub mod extremes;
