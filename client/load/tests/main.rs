//! Whole runs of `kerf-load` and its reports.

mod loopback;
mod report;
