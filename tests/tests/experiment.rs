//! The needle in liver: what `docs/explanation/experiment.md` says of it.

use kerf_system_tests::experiment::measured::{PUNCTURE, loading_depth_m, loading_n};
use kerf_system_tests::experiment::run::{griffith_n, run, scene};

#[test]
fn readings_rise_to_the_puncture() {
    assert!((loading_n(PUNCTURE.0) - PUNCTURE.1).abs() < 1e-9);
    assert!((loading_depth_m(loading_n(0.0057)) - 0.0057).abs() < 1e-9);
    assert!(loading_n(0.001) > 0.0 && loading_n(0.001) < loading_n(0.009));
}

#[test]
fn a_needle_gives_at_twice_gc_w_within_a_fifth_of_the_measured_dent_and_goes_on_at_gc_w() {
    let scene = scene(|_| {}).unwrap();
    let griffith_n = griffith_n(&scene);
    let run = run(&scene, 0.010).unwrap();
    let puncture = run.puncture();
    let steady_n = run.mean_force_n(0.007, 0.010);
    let measured_m = loading_depth_m(puncture.force_n);
    println!(
        "gives at {:.3} N, {:.2} mm, measured {:.2} mm",
        puncture.force_n,
        1e3 * puncture.depth_m,
        1e3 * measured_m
    );
    println!("goes on at {:.3} Gc w, pulled out with {:.4} N", steady_n / griffith_n, run.pull_n());
    assert!((puncture.force_n / (2.0 * griffith_n) - 1.0).abs() < 0.05);
    assert!((puncture.depth_m / measured_m - 1.0).abs() < 0.2);
    assert!((steady_n / griffith_n - 1.0).abs() < 0.1);
    assert!(run.pull_n() < 0.01 * griffith_n);
    assert!(puncture.force_n < 0.5 * PUNCTURE.1, "the capsule is not in the scene");
}
