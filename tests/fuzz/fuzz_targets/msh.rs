//! Meshes of Gmsh, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::MSH;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: MSH.write_seeds(), |bytes: &[u8]| (MSH.read)(bytes));
