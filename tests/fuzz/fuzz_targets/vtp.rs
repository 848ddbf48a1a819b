//! Surfaces of VTK, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::VTP;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: VTP.write_seeds(), |bytes: &[u8]| (VTP.read)(bytes));
