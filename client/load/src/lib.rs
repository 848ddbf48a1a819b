//! What `kerf-load` is made of: a scripted driver of a tool, viewers that keep replicas, and the
//! report on both.
//!
//! Three threads: the sender paces poses by the clock and never waits on the network; the driver's
//! runtime receives contacts, alone, so that round trips are not measured behind the viewers' work;
//! the viewers' runtime, on connections of their own, applies deltas.

pub mod args;
pub mod clock;
pub mod control;
pub mod durations;
pub mod force_age;
pub mod in_flight;
pub mod limits;
pub mod metrics;
pub mod output;
pub mod pacer;
pub mod plot;
pub mod progress;
pub mod report;
pub mod run;
pub mod script;
pub mod sender;
pub mod session;
pub mod setting;
pub mod timetable;
pub mod viewer;
pub mod wire;
