//! Ends of several ranges at once: rates with Poisson's ratios, strokes of 10 m/s at every rate, sheets of half a voxel, bodies
//! of a tenth of a millimetre and of ten metres, single voxels and columns a million times as stiff as what is around them.

use kerf_physics::scene::{ObjectDesc, RegionDesc, ShapeDesc};

use super::materials::{parameters, pressed};
use super::scenes::Specimen;
use super::supports::struck;
use super::tools::{Held, down_and_out_case};
use super::{Case, Family};

const RATES_HZ: [f64; 5] = [10.0, 60.0, 250.0, 1000.0, 4000.0];
/// What nothing holds takes no longer steps than 30 ms.
const LEAST_FREE_HZ: f64 = 34.0;
const CONTRAST: f64 = 1e6;
/// Fracture energy over `E H`: tough enough to be dented first, within what the linear law carries.
const TOUGHNESS: f64 = 0.2;

pub(super) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for rate_hz in RATES_HZ {
        for poisson_ratio in [0.0, 0.45, 0.4999] {
            for strain_stiffening in [0.0, 10.0] {
                let specimen =
                    Specimen { dt_s: 1.0 / rate_hz, poisson_ratio, strain_stiffening, ..Specimen::default() };
                let name = format!("{rate_hz} Hz, nu {poisson_ratio}, c {strain_stiffening}");
                cases.push(pressed_case(name, specimen.clone(), specimen.held_block()));
            }
        }
    }
    for rate_hz in RATES_HZ {
        let free_hz = rate_hz.max(LEAST_FREE_HZ);
        for (held, how, rate_hz) in [(Held::Base, "held", rate_hz), (Held::Nothing, "free", free_hz)] {
            cases.push(down_and_out_case(
                Family::Ends,
                format!("10 m/s at {rate_hz} Hz, {how}"),
                10.0,
                1.0 / rate_hz,
                held,
            ));
        }
    }
    for level in 0..=2 {
        let sheet =
            |strain_stiffening| Specimen { voxels: [12, 1, 12], level, strain_stiffening, ..Specimen::default() };
        for strain_stiffening in [0.0, 10.0] {
            let name = format!("a sheet of half a voxel, k {}, c {strain_stiffening}", 1 << level);
            let specimen = sheet(strain_stiffening);
            let mut block = half(&specimen);
            block.fixed.push(ShapeDesc::Box { min_m: [-1.0, -1.0, -1.0], max_m: [-0.02, 1.0, 1.0] });
            cases.push(pressed_case(name, specimen, block));
        }
        let specimen = sheet(10.0);
        let block = half(&specimen);
        cases.push(struck_case(format!("a sheet of half a voxel, k {}, free, cut at", 1 << level), specimen, block));
    }
    for (size, voxel_size_m, voxels) in [("0.08 mm", 1e-5, [8; 3]), ("10 m", 1.0, [10; 3])] {
        for level in [0, 1] {
            let specimen = Specimen { voxel_size_m, voxels, level, strain_stiffening: 10.0, ..Specimen::default() };
            for (how, block) in [("held", specimen.held_block()), ("free", specimen.block())] {
                let name = format!("a body of {size}, k {}, {how}, cut through", 1 << level);
                cases.push(struck_case(name, specimen.clone(), block));
            }
        }
    }
    for (name, shape) in [
        ("column", ShapeDesc::Box { min_m: [0.0, -1.0, 0.0], max_m: [0.01, 1.0, 0.01] }),
        ("voxel", ShapeDesc::Box { min_m: [0.0, 0.02, 0.0], max_m: [0.005, 0.025, 0.005] }),
        ("roof of one voxel", ShapeDesc::Box { min_m: [-1.0, 0.035, -1.0], max_m: [1.0; 3] }),
    ] {
        let specimen = Specimen { level: 2, ..Specimen::default() };
        let mut block = specimen.held_block();
        let mut material = specimen.material();
        material.young_modulus_pa *= CONTRAST;
        block.regions = vec![RegionDesc { name: "stiff".into(), shape, material }];
        cases.push(pressed_case(format!("a stiff {name}, {CONTRAST:.0e} : 1"), specimen, block));
    }
    cases
}

fn pressed_case(name: String, specimen: Specimen, block: ObjectDesc) -> Case {
    Case::new(Family::Ends, name, parameters(&specimen), move |budget| {
        pressed(&specimen, specimen.scene(block.clone(), 1), budget)
    })
}

fn struck_case(name: String, specimen: Specimen, mut block: ObjectDesc) -> Case {
    let element_m = specimen.voxel_size_m * f64::from(1u32 << specimen.level);
    block.material.fracture_energy_j_per_m2 = Some(TOUGHNESS * specimen.young_modulus_pa * element_m);
    Case::new(Family::Ends, name, parameters(&specimen), move |budget| {
        struck(&specimen, block.clone(), specimen.period_s(), budget)
    })
}

/// The block at half of its height.
fn half(specimen: &Specimen) -> ObjectDesc {
    let mut block = specimen.block();
    let extent_m = specimen.extent_m();
    block.shape = ShapeDesc::Box {
        min_m: [-0.5 * extent_m.x, 0.0, -0.5 * extent_m.z],
        max_m: [0.5 * extent_m.x, 0.5 * extent_m.y, 0.5 * extent_m.z],
    };
    block
}
