//! Streams that viewers get, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::messages::VIEW;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: VIEW.write_seeds(), |bytes: &[u8]| (VIEW.read)(bytes));
