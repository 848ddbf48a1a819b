//! A few random dicings, coarse; `make dice` makes a thousand at full size and writes docs/dicing.md.

use kerf_system_tests::dicing::campaign::{dice, model};
use kerf_system_tests::strokes::campaign::seeds;

#[test]
fn random_dicings_are_rolled_back_nowhere_and_make_no_energy() {
    for name in ["liver", "jelly"] {
        let scene = model(name, Some(14)).expect("a built-in scene");
        for seed in seeds(3).take(3) {
            let tally = dice(&scene, seed, 8).expect("a sound scene");
            assert!(tally.findings.is_empty(), "{name}: {tally:#?}");
            assert!(tally.parted_links > 100, "{name}: {tally:#?}");
        }
    }
}
