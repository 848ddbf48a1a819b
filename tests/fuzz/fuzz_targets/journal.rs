//! Journals, MCAP files, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::states::JOURNAL;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: JOURNAL.write_seeds(), |bytes: &[u8]| (JOURNAL.read)(bytes));
