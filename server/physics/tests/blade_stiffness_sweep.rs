//! Measures what a blade feels: prints the constants of the contact's compliance as the elements have
//! them, then the stiffness of a block under a blade against full FEM under a resolved edge. Minutes.

use super::indentation::block::{HEIGHT_M, Press};
use super::indentation::{layer, strip::Strip};

const H_M: f64 = 1.25e-3;
const POISSON: [f64; 3] = [0.3, 0.45, 0.49];

#[test]
#[ignore = "slow: minutes; prints what the constants of the compliance were read from"]
fn sweep() {
    constants();
    println!("\nStiffness of a block under a blade, error in % against the resolved edge, mean / worst over 8 places");
    println!("nu    a mm   turn tilt height mm     k = 1        k = 2        k = 4        k = 8");
    for poisson in POISSON {
        for (half_width, turns) in
            [(5e-5, &[0.0, 10.0, 22.5, 45.0][..]), (2.5e-4, &[0.0, 45.0]), (1.25e-3, &[0.0, 45.0])]
        {
            turns.iter().for_each(|turn| block(&Press::new(poisson, half_width, *turn)));
        }
        block(&Press { tilt_deg: 20.0, ..Press::new(poisson, 5e-5, 0.0) });
        for layers in [1.0, 2.0, 4.0, 6.0] {
            block(&Press { height_m: HEIGHT_M + layers * H_M, ..Press::new(poisson, 5e-5, 0.0) });
        }
    }
    ripple();
}

/// What a layer of elements gives more, under a line load, than a layer of the continuum under an edge of
/// half-width H.
fn constants() {
    println!(
        "Surplus of the elements' compliance at a node over (1 - nu^2), and the fraction of it that is gone between nodes"
    );
    for poisson in [0.0, 0.3, 0.45, 0.49] {
        for (level, filled) in [(0, 1), (1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (2, 4), (3, 4), (3, 8)] {
            let strip = Strip::new(level, poisson, 24, filled);
            let share = filled as f64 / f64::from(1u32 << level);
            let truth = layer::compliance(poisson, strip.depth);
            let node = strip.compliance(&[(0, 1.0)], share) - truth;
            let between = strip.compliance(&[(0, 0.5), (1, 0.5)], share) - truth;
            println!(
                "nu {poisson:4}  k {}  filled {share:5}: {:.4}  {:.4}",
                1 << level,
                node / (1.0 - poisson * poisson),
                1.0 - between / node
            );
        }
    }
}

fn block(press: &Press) {
    let reference = press.reference_n_per_m();
    let mut line = format!(
        "{:4} {:6.3} {:6} {:4} {:8.2}   ",
        press.poisson_ratio,
        press.half_width_m * 1e3,
        press.turn_deg,
        press.tilt_deg,
        press.height_m * 1e3
    );
    for level in 0..=3 {
        let errors = press.errors(H_M, level, reference, 1);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let worst = errors.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN);
        line += &format!(" {:+5.1} /{:+5.1}", mean * 100.0, worst * 100.0);
    }
    println!("{line}");
}

/// The force while a blade slides from the middle of a cell to the next.
fn ripple() {
    println!(
        "\nRipple +- % of the force and its largest change % in a step of 15 um, sliding from the middle of a cell to the next"
    );
    for (poisson, width_m) in POISSON.into_iter().flat_map(|nu| [(nu, 0.02), (nu, 0.12)]) {
        for turn in [0.0, 22.5, 45.0] {
            let mut line = format!("nu {poisson:4} edge {width_m} m, turn {turn:4}:");
            for level in 0..=3 {
                let cell = H_M * f64::from(1u32 << level);
                let press = Press { width_m, ..Press::new(poisson, 5e-5, turn) };
                let (ripple, jump) = press.slide(H_M, level, cell);
                line += &format!("  k {} {:5.2} {:5.2}", 1 << level, 100.0 * ripple, 100.0 * jump);
            }
            println!("{line}");
        }
    }
}
