//! Scenes as text, under libFuzzer.
#![no_main]

use kerf_system_tests::readers::files::SCENE;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: SCENE.write_seeds(), |bytes: &[u8]| (SCENE.read)(bytes));
