//! Meshes in OBJ, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::OBJ;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: OBJ.write_seeds(), |bytes: &[u8]| (OBJ.read)(bytes));
