//! Recordings, MCAP files, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::states::RECORDING;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: RECORDING.write_seeds(), |bytes: &[u8]| (RECORDING.read)(bytes));
