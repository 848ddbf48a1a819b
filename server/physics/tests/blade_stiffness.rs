//! A blade pressed on a block feels as stiff as the continuum, wherever it stands in its cell, however it is
//! turned, whatever the level. `blade_stiffness_sweep` is the whole of it.

use super::indentation::block::Press;
use super::indentation::{layer, strip::Strip};

/// Voxels of the block, m.
const H_M: f64 = 1.25e-3;
const HALF_WIDTH_M: f64 = 5e-5;

fn mean_and_worst(errors: &[f64]) -> (f64, f64) {
    let worst = errors.iter().map(|e| e.abs()).fold(0.0, f64::max);
    (errors.iter().sum::<f64>() / errors.len() as f64, worst)
}

#[test]
fn an_edge_that_full_fem_resolves_dents_a_layer_as_theory_says() {
    // What the fine reference of the other tests is: Chebyshev's points over 2.5 voxels.
    for poisson in [0.3, 0.45, 0.49] {
        let strip = Strip::new(0, poisson, 30, 1);
        for place in [0.0, 0.25, 0.5] {
            let points: Vec<(i32, f64)> = (0..6)
                .map(|j| place + 2.5 * (f64::from(2 * j + 1) * std::f64::consts::PI / 12.0).cos())
                .flat_map(|x| [(x.floor(), 1.0 - x.rem_euclid(1.0)), (x.floor() + 1.0, x.rem_euclid(1.0))])
                .map(|(column, share)| (column as i32, share / 6.0))
                .collect();
            let (measured, theory) = (strip.compliance(&points, 1.0), layer::compliance(poisson, strip.depth / 2.5));
            println!("nu {poisson}, place {place}: E u/q {measured:.4}, theory {theory:.4}");
            assert!((measured - theory).abs() < 0.04, "nu {poisson}: {measured} against {theory}");
        }
    }
}

#[test]
fn a_blade_feels_as_stiff_as_the_continuum_wherever_it_stands_and_however_it_is_turned() {
    feels_as_the_continuum(&[(0.3, 0.0), (0.45, 22.5)]);
}

#[test]
#[ignore = "slow: two more pairs of Poisson's ratio and turn"]
fn a_blade_feels_as_stiff_along_the_cells_and_halfway_between() {
    feels_as_the_continuum(&[(0.45, 0.0), (0.45, 45.0)]);
}

fn feels_as_the_continuum(cases: &[(f64, f64)]) {
    for &(poisson, turn_deg) in cases {
        let press = Press::new(poisson, HALF_WIDTH_M, turn_deg);
        let reference = press.reference_n_per_m();
        for level in [1, 2, 3] {
            let errors = press.errors(H_M, level, reference, 3);
            let (mean, worst) = mean_and_worst(&errors);
            println!(
                "nu {poisson}, turn {turn_deg}, k {}: {:+.1} %, at worst {:.1} %",
                1 << level,
                mean * 100.0,
                worst * 100.0
            );
            assert!(worst < 0.05, "nu {poisson}, turn {turn_deg}, level {level}: {errors:.3?}");
        }
    }
}

#[test]
fn the_force_keeps_within_three_percent_while_a_blade_slides() {
    // Of four cells and more, and all across the block. (Across it and askew, shares come in at its sides.)
    for (turn_deg, level, width_m) in
        [(0.0, 1, 0.02), (0.0, 2, 0.02), (0.0, 2, 0.12), (0.0, 3, 0.12), (22.5, 2, 0.02), (45.0, 2, 0.02)]
    {
        // From the middle of a cell into that of the next.
        let cell = H_M * f64::from(1u32 << level);
        let press = Press { width_m, ..Press::new(0.45, HALF_WIDTH_M, turn_deg) };
        let (ripple, jump) = press.slide(H_M, level, cell);
        println!(
            "turn {turn_deg}, k {}, edge of {width_m} m: ripple +-{:.2} %, at most {:.2} % from step to step",
            1 << level,
            ripple * 100.0,
            jump * 100.0
        );
        assert!(ripple < 0.03, "turn {turn_deg}, level {level}: {ripple}");
        assert!(jump < 0.002, "turn {turn_deg}, level {level}: {jump} in a step of 15 um");
    }
}

/// The elements' share of the compliance is that under long edges; under short ones it is more.
#[test]
fn a_short_edge_feels_nearly_as_stiff_as_the_continuum() {
    short_edges_feel_as_the_continuum(&[(0.5, 0.07, 0.2), (1.5, 0.02, 0.06)]);
}

#[test]
#[ignore = "slow: two more lengths of the edge"]
fn edges_of_whole_elements_feel_nearly_as_stiff_as_the_continuum() {
    short_edges_feel_as_the_continuum(&[(1.0, 0.04, 0.1), (2.0, 0.02, 0.05)]);
}

/// Edges so many elements long, with bounds on the mean error and the worst.
fn short_edges_feel_as_the_continuum(cases: &[(f64, f64, f64)]) {
    let level = 2;
    let cell_m = H_M * f64::from(1u32 << level);
    for &(elements, mean_bound, bound) in cases {
        let press = Press { width_m: elements * cell_m, ..Press::new(0.45, HALF_WIDTH_M, 0.0) };
        let errors = press.errors(H_M, level, press.reference_n_per_m(), 1);
        let (mean, worst) = mean_and_worst(&errors);
        println!("edge of {elements} elements: {:+.1} %, at worst {:.1} %", mean * 100.0, worst * 100.0);
        assert!(mean.abs() < mean_bound && worst < bound, "{elements} elements: {errors:.3?}");
    }
}
