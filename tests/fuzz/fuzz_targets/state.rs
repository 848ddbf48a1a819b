//! States of a world, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::states::STATE;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: STATE.write_seeds(), |bytes: &[u8]| (STATE.read)(bytes));
