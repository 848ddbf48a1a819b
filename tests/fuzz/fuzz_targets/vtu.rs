//! Grids of VTK, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::VTU;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: VTU.write_seeds(), |bytes: &[u8]| (VTU.read)(bytes));
