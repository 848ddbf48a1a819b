//! One published curve of force over depth beside ours: a needle pushed into bovine liver.

pub mod measured;
mod plot;
mod report;
pub mod run;

use std::path::Path;

use anyhow::{Context, Result};
use kerf_physics::scene::{MaterialDesc, ObjectDesc, ShapeDesc};
use rayon::prelude::*;
use run::Run;

/// Depth to which the needle is pushed, m: from there on the measured needle meets vessels.
const DEPTH_M: f64 = 0.018;
/// Half of the piece's width in the scene, m.
const HALF_WIDTH_M: f64 = 0.025;

/// The scene with one thing changed.
struct Case {
    name: &'static str,
    change: fn(&mut ObjectDesc),
}

/// Gc by Gokgol and others, least and most, J/m^2.
const GC_J_PER_M2: [f64; 2] = [158.0, 170.0];
/// Young's modulus, least and most, Pa.
const YOUNG_PA: [f64; 2] = [5.4e3, 1.5e4];

const CASES: [Case; 13] = [
    Case { name: "the scene", change: |_| {} },
    Case { name: "E 5.4 kPa", change: |liver| liver.material.young_modulus_pa = YOUNG_PA[0] },
    Case { name: "E 15 kPa", change: |liver| liver.material.young_modulus_pa = YOUNG_PA[1] },
    Case { name: "Gc 158 J/m^2", change: |liver| gc(&mut liver.material, GC_J_PER_M2[0]) },
    Case { name: "Gc 170 J/m^2", change: |liver| gc(&mut liver.material, GC_J_PER_M2[1]) },
    Case { name: "Gc 76 J/m^2, least of pig's, needles", change: |liver| gc(&mut liver.material, 76.0) },
    Case { name: "Gc 225 J/m^2, most of pig's, blade", change: |liver| gc(&mut liver.material, 225.0) },
    Case { name: "stiffening 5", change: |liver| liver.material.strain_stiffening = 5.0 },
    Case { name: "stiffening 20", change: |liver| liver.material.strain_stiffening = 20.0 },
    Case { name: "voxels of 1.5 mm", change: |liver| meshed(liver, 1.5e-3) },
    Case { name: "voxels of 1 mm", change: |liver| meshed(liver, 1e-3) },
    Case { name: "the needle between voxels", change: |liver| half_width(liver, 0.026) },
    CAPSULE,
];

/// The one number that is fitted: the initiation ratio that puts the puncture at the measured force. The finer
/// elements of the scene would fold before that.
const CAPSULE: Case = Case {
    name: "initiation ratio 6.8, fitted; voxels of 3.2 mm",
    change: |liver| {
        liver.material.initiation_ratio = 6.8;
        meshed(liver, 3.2e-3);
    },
};

/// The corners of what stiffness and toughness may be.
const CORNERS: [fn(&mut ObjectDesc); 4] = [
    |liver| corner(liver, 0, 0),
    |liver| corner(liver, 0, 1),
    |liver| corner(liver, 1, 0),
    |liver| corner(liver, 1, 1),
];

fn gc(material: &mut MaterialDesc, j_per_m2: f64) {
    material.fracture_energy_j_per_m2 = Some(j_per_m2);
}

/// Other voxels, the needle in the middle of some: an odd number of them across.
fn meshed(liver: &mut ObjectDesc, voxel_m: f64) {
    liver.voxel_size_m = Some(voxel_m);
    half_width(liver, ((HALF_WIDTH_M / voxel_m - 0.5).round() + 0.5) * voxel_m);
}

fn half_width(liver: &mut ObjectDesc, half_m: f64) {
    if let ShapeDesc::Box { min_m: [x0, _, z0], max_m: [x1, _, z1] } = &mut liver.shape {
        [*x0, *z0, *x1, *z1] = [-half_m, -half_m, half_m, half_m];
    }
}

fn corner(liver: &mut ObjectDesc, young: usize, toughness: usize) {
    liver.material.young_modulus_pa = YOUNG_PA[young];
    gc(&mut liver.material, GC_J_PER_M2[toughness]);
}

/// A case as it went.
struct Row {
    name: &'static str,
    griffith_n: f64,
    run: Run,
}

fn row(case: &Case) -> Result<Row> {
    let scene = run::scene(case.change).with_context(|| case.name)?;
    let run = run::run(&scene, DEPTH_M).with_context(|| case.name)?;
    Ok(Row { name: case.name, griffith_n: run::griffith_n(&scene), run })
}

/// Runs every case and writes `experiment.md` and its plot to a folder.
///
/// # Errors
/// A run fails or a file cannot be written.
pub fn write(folder: &Path) -> Result<()> {
    let rows: Vec<Row> = CASES.par_iter().map(row).collect::<Result<_>>()?;
    let corner = |change: &fn(&mut ObjectDesc)| run::run(&run::scene(*change)?, DEPTH_M);
    let corners: Vec<Run> = CORNERS.par_iter().map(corner).collect::<Result<_>>()?;
    plot::figure(&rows, &corners).draw(folder)?;
    let path = folder.join("experiment.md");
    std::fs::write(&path, report::markdown(&rows)).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_needle_of_one_marker_keeps_its_force_to_the_end() {
        let row = row(&CAPSULE).unwrap();
        let force = row.run.mean_force_n(DEPTH_M - 4e-3, DEPTH_M) / row.griffith_n;
        println!("mean force of the last 4 mm over Gc w {force:.3}");
        assert!((force - 1.0).abs() < 0.1, "{force}");
    }
}
