//! Meshes in STL, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::STL;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: STL.write_seeds(), |bytes: &[u8]| (STL.read)(bytes));
