//! Prints the state hashes of strokes into blocks. `tests/determinism.rs` builds it for other
//! instruction sets and profiles and compares what it prints.
#![allow(clippy::print_stdout, reason = "its output is what it is for")]

#[path = "../tests/support/mod.rs"]
mod support;

fn main() {
    println!("{}", support::press::hashes_of_all_laws());
}
