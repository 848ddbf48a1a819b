//! What `kerf-load` is made of: scripted drivers of tools, viewers that keep replicas, and the
//! report on both.
//!
//! Each session that is driven has two threads: the sender paces poses by the clock and never waits on the network; the
//! viewers' runtime, on connections of their own, applies deltas. One more runtime receives contacts, those of all
//! sessions and nothing else, so that round trips are not measured behind the viewers' work.

pub mod args;
pub mod clock;
pub mod control;
pub mod durations;
pub mod fleet;
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
