//! Label maps in NIfTI, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::NIFTI;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: NIFTI.write_seeds(), |bytes: &[u8]| (NIFTI.read)(bytes));
