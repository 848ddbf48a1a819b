//! A few random strokes; `make strokes` makes thousands and writes docs/strokes.md.

use kerf_system_tests::strokes::campaign::run;
use kerf_system_tests::strokes::model::Model;

#[test]
fn random_strokes_through_a_coarse_liver_leave_nothing_broken() {
    let model = Model::new("liver", 20).expect("the liver");
    let tally = run(&model, 30, 1, |_| ()).expect("a sound scene");
    println!("{tally:#?}");
    assert!(tally.cutting_strokes >= 15, "{} strokes cut", tally.cutting_strokes);
    assert!(tally.findings.is_empty(), "{:#?}", tally.findings);
}
