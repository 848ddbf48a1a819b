//! Edges of blades, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::EDGE;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: EDGE.write_seeds(), |bytes: &[u8]| (EDGE.read)(bytes));
