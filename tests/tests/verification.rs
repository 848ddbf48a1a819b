//! The coarse part of the verification cases against bounds; `make verify` runs all of them.

use kerf_system_tests::verification::{
    Extent, Family, bending, cantilever, cutting, elements, filled, half_space, held, link_rule, motion, probe,
    release, scissors, spin, tearing, tip_load, uniaxial,
};

fn coarse(family: fn(Extent) -> anyhow::Result<Family>) -> Family {
    family(Extent::Coarse).expect("every body comes to rest")
}

/// Holds every row whose case begins with `case` to a bound on its error; there must be one.
fn hold(family: &Family, case: &str, bound: f64) {
    let mut rows = family.tables.iter().flat_map(|t| &t.rows).filter(|r| r.case.starts_with(case)).peekable();
    assert!(rows.peek().is_some(), "no case begins with {case:?}");
    for row in rows {
        println!("{}: worst error {:.1e}", row.case, row.worst());
        assert!(row.worst() <= bound, "{}: {:?} against {:?}", row.case, row.ours, row.reference);
    }
}

#[test]
fn patches_turned_bodies_and_gradients_hold_to_round_off() {
    let family = coarse(elements::family);
    hold(&family, "patch", 1e-11);
    hold(&family, "rotation", 1e-11);
    hold(&family, "force + dU/dx", 1e-8);
}

#[test]
fn a_pulled_block_strains_as_hooke_says_whatever_its_cells_hold() {
    hold(&coarse(uniaxial::family), "", 1e-6);
}

#[test]
fn composite_elements_bend_as_full_fem_of_the_same_voxels() {
    let family = coarse(bending::family);
    for (poisson, bound) in [("nu 0.3:", 0.025), ("nu 0.45:", 0.03), ("nu 0.49:", 0.08)] {
        hold(&family, &format!("8 voxels across, {poisson}"), bound);
    }
}

#[test]
fn a_cantilever_sags_and_swings_as_beam_theory_says() {
    let family = coarse(cantilever::family);
    hold(&family, "small load", 0.05);
    hold(&family, "own weight: tip down", 0.05);
    hold(&family, "own weight: tip back", 0.09);
    hold(&family, "first frequency", 0.02);
}

#[test]
fn a_tip_load_bends_far_as_the_elastica() {
    hold(&coarse(tip_load::family), "P L^2", 3e-3);
}

#[test]
fn pressed_half_spaces_sink_as_love_and_flamant_say() {
    let family = coarse(half_space::family);
    hold(&family, "nu 0.3: strip", 0.015);
    hold(&family, "nu 0.45: square", 0.01);
}

#[test]
fn parted_links_release_what_fracture_mechanics_says() {
    let family = coarse(release::family);
    hold(&family, "strip", 0.05);
    hold(&family, "double cantilever, a/h 5: the same", 0.05);
    hold(&family, "double cantilever, h = 20 mm", 0.07);
}

#[test]
fn free_motion_keeps_momenta_and_bounds_the_energy() {
    let family = coarse(motion::family);
    hold(&family, "tumbling fragments: linear", 1e-10);
    hold(&family, "tumbling fragments: angular", 1e-10);
    hold(&family, "tumbling fragments: energy", 0.0);
    for start in ["stretched", "collapsed", "random"] {
        hold(&family, start, 1e-10);
    }
}

#[test]
fn a_cut_takes_griffiths_balance_by_the_front_and_the_meshs_by_the_energy_of_links() {
    let family = link_rule::compare(Extent::Coarse).expect("the block is cut").family();
    hold(&family, "front: steady", 0.02);
    hold(&family, "front: work", 0.02);
    hold(&family, "front: energy residual", 0.0);
    hold(&family, "link energy: energy residual", 0.0);
    // c_k is of small strains. It falls at larger loads, by a quarter where the linear law ends: on these meshes by a tenth.
    hold(&family, "link energy: first", 0.12);
    let steady = family.tables[0].rows.iter().find(|r| r.case.starts_with("link energy: steady")).expect("a row");
    assert!(steady.ours.iter().all(|ratio| *ratio > 10.0), "{:?}", steady.ours);
    assert!(steady.ours[0] > 1.5 * steady.ours[1], "k 4 against k 2: {:?}", steady.ours);
}

/// Holds every check whose case has `part` in it to its limit; there must be one.
fn hold_checks(family: &Family, part: &str) {
    let mut checks = family.checks.iter().filter(|check| check.case.contains(part)).peekable();
    assert!(checks.peek().is_some(), "no case has {part:?} in it");
    for check in checks {
        println!(
            "{}: {:.4} of {:.4}, residual {:.1e}",
            check.case,
            check.ours,
            check.reference,
            check.residual.unwrap_or(0.0)
        );
        assert!(check.is_met(), "{}: {} of {}", check.case, check.ours, check.reference);
    }
}

#[test]
fn steady_cuts_take_gc_per_width_and_release_gc_per_area() {
    let family = coarse(cutting::steady::family);
    [
        "liver, k 4, h 7 mm, 1 ms",
        "liver, k 8",
        "(1,1,0)",
        "(1,1,1): F",
        "(1,1,1): -d",
        "work of the tool",
        "bar of real liver",
        "Young's",
    ]
    .iter()
    .for_each(|part| hold_checks(&family, part));
}

#[test]
fn the_force_of_a_cut_goes_with_width_slide_speed_and_region() {
    hold_checks(&coarse(cutting::variations::family), "");
}

#[test]
fn a_tear_runs_at_the_speed_of_waves_whatever_the_step() {
    let family = coarse(tearing::family);
    hold(&family, "speed", 0.06);
}

#[test]
fn a_cantilever_on_one_layer_of_voxels_bends_as_far_as_on_whole_elements() {
    hold_checks(&coarse(held::family), "one layer held");
}

#[test]
fn boxes_off_the_lattice_weigh_what_they_should_and_bend_nearly_so() {
    let family = coarse(filled::family);
    hold(&family, "", 1e-4);
    hold_checks(&family, "bar of 18 mm");
}

#[test]
fn a_spinning_bar_is_stretched_by_its_spin_whatever_the_step() {
    let family = coarse(spin::family);
    hold(&family, "1000 Hz", 0.005);
    hold(&family, "60 Hz", 0.05);
}

#[test]
fn a_probe_is_pressed_back_as_hertz_says() {
    hold_checks(&coarse(probe::family), "mm deep");
}

#[test]
fn scissors_pay_for_the_section_that_they_cut() {
    hold_checks(&coarse(scissors::family), "");
}
