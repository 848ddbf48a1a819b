//! Steps with poses, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::messages::POSES;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: POSES.write_seeds(), |bytes: &[u8]| (POSES.read)(bytes));
