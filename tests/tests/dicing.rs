//! A few random dicings of a coarse liver; `make dice` makes 200 of five models.

use kerf_system_tests::dicing::campaign::{dice, model};
use kerf_system_tests::strokes::campaign::seeds;

#[test]
fn random_dicings_of_a_coarse_liver_are_rolled_back_nowhere_and_make_no_energy() {
    let scene = model("liver", Some(14)).expect("a built-in scene");
    let mut parted_links = 0;
    for seed in seeds(3).take(2) {
        let tally = dice(&scene, seed, 8).expect("a sound scene");
        assert!(tally.findings.is_empty(), "{tally:#?}");
        parted_links += tally.parted_links;
    }
    assert!(parted_links > 100, "{parted_links} links parted");
}
