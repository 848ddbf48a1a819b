//! Prints the state hashes of a stroke into a block. `tests/determinism.rs` builds it for other
//! instruction sets and profiles and compares what it prints.
#![allow(clippy::print_stdout, reason = "its output is what it is for")]

#[path = "../tests/support/mod.rs"]
mod support;

fn main() {
    println!("{}", support::press::hashes_of_two_materials());
}
