//! Scripts of motions, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::SCRIPT;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: SCRIPT.write_seeds(), |bytes: &[u8]| (SCRIPT.read)(bytes));
