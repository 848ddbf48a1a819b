//! Label maps in NRRD, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::NRRD;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: NRRD.write_seeds(), |bytes: &[u8]| (NRRD.read)(bytes));
