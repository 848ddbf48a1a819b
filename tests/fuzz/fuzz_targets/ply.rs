//! Meshes in PLY, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::PLY;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: PLY.write_seeds(), |bytes: &[u8]| (PLY.read)(bytes));
