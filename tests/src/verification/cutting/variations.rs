//! What the force of a cut goes with: the width, the edge's way through the material, its speed, and what the
//! material is where the edge stands.

use anyhow::{Context, Result};
use kerf_physics::Vec3;
use kerf_physics::scene::{MaterialDesc, RateDesc, RegionDesc, ShapeDesc};
use kerf_plot::{Axis, Chart, Curve, Figure};
use rayon::prelude::*;

use super::rig::{Rig, Setup, ledger_residual, mean_force_n, sum};
use super::steady::liver;
use super::stroke::{Stroke, gc};
use crate::verification::{Check, Extent, Family};

/// Largest error.
const LIMIT: f64 = 0.05;
/// How deep the edge is when it has begun to cut evenly, m.
const IN_M: f64 = 0.035;
/// Way down over which the force turns as an edge begins to slide, m: some tens of Gc/E.
const TURN_M: f64 = 0.049;
/// Way down over which the force is taken, m.
const STROKE_M: f64 = 0.014;

/// A figure of a run as a row.
fn check(case: String, [reference, ours]: [f64; 2], rig: &Rig, source: &'static str) -> Check {
    Check { case, reference, ours, limit: Some(LIMIT), residual: Some(ledger_residual(&rig.samples)), source }
}

/// The base: the paper's liver on its scene's mesh, or on one twice as coarse.
fn base(extent: Extent) -> Result<Stroke> {
    liver(4, if extent == Extent::Full { 3.5e-3 } else { 7e-3 })
}

/// Drives a blade along `before_m`, then along `way_m` with the mean force of that.
fn forces_n(setup: &Setup, before_m: &[Vec3], way_m: Vec3) -> Result<(Rig, Vec3)> {
    let mut rig = Rig::new(setup)?;
    before_m.iter().try_for_each(|by_m| rig.drive(*by_m))?;
    let begin = rig.samples.len();
    rig.drive(way_m)?;
    let force_n = mean_force_n(&rig.samples[begin..]);
    Ok((rig, force_n))
}

fn down(by_m: f64) -> Vec3 {
    -Vec3::y() * by_m
}

/// Slope of the force against the width, by least squares.
fn widths(extent: Extent) -> Result<(Vec<Check>, Figure)> {
    let base = base(extent)?;
    let gc = gc(&base.material);
    let widths_m = extent.of(&[0.028, 0.056, 0.084, 0.112, 0.14], 2);
    let run = |width_m: &f64| {
        let [x, y, _] = base.size_m;
        let stroke = Stroke { size_m: [x, y, *width_m], ..base.clone() };
        forces_n(&stroke.setup(), &[down(IN_M + STROKE_M)], down(STROKE_M))
    };
    let runs = widths_m.par_iter().map(run).collect::<Result<Vec<_>>>()?;
    let points: Vec<(f64, f64)> = widths_m.iter().zip(&runs).map(|(w, run)| (*w, run.1.y)).collect();
    let n = points.len() as f64;
    let (mean_w, mean_f) = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let moment = |f: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(|p| (p.0 - mean_w) * f(p)).sum::<f64>();
    let slope = moment(&|p| p.1) / moment(&|p| p.0);
    let residual = runs.iter().map(|run| ledger_residual(&run.0.samples)).fold(0.0, f64::max);
    let row = Check {
        case: "slope of F against w, J/m^2".into(),
        reference: gc,
        ours: slope,
        limit: Some(LIMIT),
        residual: Some(residual),
        source: "F = Gc w, Atkins 2009",
    };
    let longest_m = widths_m[widths_m.len() - 1];
    let fit = |w: f64| (1e3 * w, mean_f + slope * (w - mean_w));
    let figure = Figure::new(
        "verification-width",
        &format!("Force of a steady cut by width: slope {slope:.0} J/m^2, Gc {gc:.0} J/m^2"),
        Chart::new(
            Axis::linear("width, mm"),
            Axis::linear("force, N"),
            vec![
                Curve::dots("cuts", points.iter().map(|p| (1e3 * p.0, p.1)).collect()),
                Curve::line("least squares", vec![fit(0.0), fit(1.3 * longest_m)]),
            ],
        ),
    );
    Ok((vec![row], figure))
}

/// The slice-push table, and edges that are tilted and driven straight down.
fn slices(extent: Extent) -> Result<(Vec<Check>, Figure)> {
    const SOURCE: &str = "F_V = Gc w / (1 + xi^2), F_H = xi F_V, Atkins, Xu, Jeronimidis 2004";
    let mut base = liver(4, 7e-3)?;
    // Twice as wide: one that is slender along the edge bends as it is dragged, by a tilted edge too, and unbends as the front
    // comes down, which adds to the slide.
    base.size_m[2] *= 2.0;
    let gc_w_n = base.gc_w_n();
    let ratios = extent.of(&[0.0, 2.0, 0.25, 0.5, 1.0, 3.0, 4.0, -2.0], 2);
    let run = |ratio: &f64| {
        let mut setup = base.setup();
        // Wide enough that it covers the block wherever it slides.
        setup.blade_width_m += 2.0 * (TURN_M + STROKE_M) * ratio.abs();
        let way = Vec3::z() * *ratio - Vec3::y();
        forces_n(&setup, &[down(IN_M), way * TURN_M], way * STROKE_M)
    };
    let runs = ratios.par_iter().map(run).collect::<Result<Vec<_>>>()?;
    let mut checks = Vec::new();
    let (mut along, mut across) = (Vec::new(), Vec::new());
    for (ratio, (rig, force_n)) in ratios.iter().zip(&runs) {
        let share = 1.0 / (1.0 + ratio * ratio);
        let (push, slice) = (force_n.y / gc_w_n, -force_n.z / gc_w_n);
        checks.push(check(format!("slice-push {ratio}: F_V / Gc w"), [share, push], rig, SOURCE));
        if *ratio != 0.0 {
            checks.push(check(format!("slice-push {ratio}: F_H / Gc w"), [ratio * share, slice], rig, SOURCE));
        }
        if *ratio >= 0.0 {
            across.push((*ratio, push));
            along.push((*ratio, slice));
        }
    }
    for tilt_deg in extent.of(&[15.0f64, 30.0], 0) {
        checks.push(tilted(&base, tilt_deg)?);
    }
    let theory = |of: fn(f64) -> f64| (0..=80).map(|i| 0.05 * f64::from(i)).map(|xi| (xi, of(xi))).collect();
    let figure = Figure::new(
        "verification-slicing",
        "A straight edge that slides xi times what it advances",
        Chart::new(
            Axis::linear("slice-push ratio xi"),
            Axis::linear("force over Gc w"),
            vec![
                Curve::line("F_V, theory", theory(|xi| 1.0 / (1.0 + xi * xi))),
                Curve::dots("F_V", across),
                Curve::line("F_H, theory", theory(|xi| xi / (1.0 + xi * xi))),
                Curve::dots("F_H", along),
            ],
        ),
    );
    Ok((checks, figure))
}

/// A tilted edge that is driven straight down: Gc for the block's width times the way down.
fn tilted(base: &Stroke, tilt_deg: f64) -> Result<Check> {
    let mut setup = base.setup();
    let (sin, cos) = tilt_deg.to_radians().sin_cos();
    setup.hold.along = Vec3::new(0.0, sin, cos);
    setup.hold.forward = Vec3::new(0.0, -cos, sin);
    let entry_m = base.width_m() * sin / cos;
    setup.hold.start_m.y += 0.5 * entry_m;
    let (rig, force_n) = forces_n(&setup, &[down(IN_M + STROKE_M + entry_m)], down(STROKE_M))?;
    let case = format!("edge tilted by {tilt_deg} deg, straight down: F / Gc w");
    let source = "Gc per area, Atkins, Xu, Jeronimidis 2004";
    Ok(check(case, [1.0, force_n.y / base.gc_w_n()], &rig, source))
}

/// Gc that rises with the speed of the cut.
fn speeds(extent: Extent) -> Result<Vec<Check>> {
    let mut base = liver(4, 7e-3)?;
    base.material.rate = Some(RateDesc { reference_speed_m_per_s: 0.02, exponent: 0.5 });
    let run = |speed_m_per_s: &f64| {
        let stroke = Stroke { speed_m_per_s: *speed_m_per_s, ..base.clone() };
        let factor = (speed_m_per_s / 0.02).max(1.0).sqrt();
        let (rig, force_n) = forces_n(&stroke.setup(), &[down(IN_M + STROKE_M)], down(STROKE_M))?;
        let case = format!("Gc (v / 20 mm/s)^0.5 at {} mm/s: F / Gc w", 1e3 * speed_m_per_s);
        let source = "Gc max(1, v / v0)^p: the material's law, as Forte 2015 measured gelatine";
        Ok(check(case, [factor, force_n.y / base.gc_w_n()], &rig, source))
    };
    extent.of(&[0.08, 0.01, 0.02, 0.045], 1).par_iter().map(run).collect()
}

/// A stiff and tough lesion over part of the width.
fn lesion(extent: Extent) -> Result<Vec<Check>> {
    let mut stroke = base(extent)?;
    // Its depths and its reach along the edge, m; the modulus and the toughness of the scene `hepatectomy`'s.
    let (depths_m, reach_m) = ([0.049, 0.112], [0.014, 0.035]);
    let top_m = stroke.size_m[1];
    let tough = MaterialDesc {
        young_modulus_pa: 4.0 * stroke.material.young_modulus_pa,
        fracture_energy_j_per_m2: Some(3.0 * gc(&stroke.material)),
        ..stroke.material.clone()
    };
    let shape = ShapeDesc::Box {
        min_m: [-1.0, top_m - depths_m[1], reach_m[0]],
        max_m: [1.0, top_m - depths_m[0], reach_m[1]],
    };
    let inside_m = reach_m[1] - reach_m[0];
    let plateau_n = gc(&tough) * inside_m + gc(&stroke.material) * (stroke.width_m() - inside_m);
    stroke.regions = vec![RegionDesc { name: "lesion".into(), shape, material: tough }];
    // Between the lesion's top and bottom the front lags behind the blade by what it dents.
    let (rig, force_n) = forces_n(&stroke.setup(), &[down(depths_m[0] + 2.0 * STROKE_M)], down(STROKE_M))?;
    let case = "lesion of 4 E and 3 Gc over 21 of 56 mm: F, N".into();
    let source = "sum of Gc w over the regions, Griffith 1921";
    Ok(vec![check(case, [plateau_n, force_n.y], &rig, source)])
}

/// A tough vessel across the cut.
fn vessel() -> Result<Vec<Check>> {
    let mut stroke = Stroke { speed_m_per_s: 0.1, ..base(Extent::Full)? };
    let (radius_m, depth_m) = (0.0105, 0.07);
    let [length_m, top_m, width_m] = stroke.size_m;
    let tough = MaterialDesc {
        young_modulus_pa: 2.0 * stroke.material.young_modulus_pa,
        fracture_energy_j_per_m2: Some(4.0 * gc(&stroke.material)),
        ..stroke.material.clone()
    };
    let extra_j_per_m2 = gc(&tough) - gc(&stroke.material);
    let end_m = |x: f64| [x, top_m - depth_m, 0.5 * width_m];
    let shape = ShapeDesc::Capsule { from_m: end_m(-length_m), to_m: end_m(2.0 * length_m), radius_m };
    stroke.regions = vec![RegionDesc { name: "vessel".into(), shape, material: tough }];
    let mut rig = Rig::new(&stroke.setup())?;
    rig.advance(depth_m - 2.0 * radius_m)?;
    let (before, begin) = (rig.rest()?.context("no rest above the vessel")?, rig.samples.len());
    rig.advance(5.0 * radius_m)?;
    let after = rig.rest()?.context("no rest below the vessel")?;
    let passage = &rig.samples[begin..];
    let spent_j = sum(passage, |e| e.tool_work_j) - (after.stored_j - before.stored_j);
    let area_m2 = after.area_m2 - before.area_m2;
    let due_j = gc(&stroke.material) * area_m2 + extra_j_per_m2 * disc_m2(radius_m, stroke.mesh.voxel_m);
    let highest_n = passage.iter().map(|s| s.force_n.y).fold(0.0, f64::max);
    let widest_n = stroke.gc_w_n() + extra_j_per_m2 * 2.0 * radius_m;
    let name = "vessel of 2 E, 4 Gc and 21 mm across";
    let source = "sum of Gc w over the regions, Griffith 1921";
    let work =
        check(format!("{name}: work of the tool less stored, J"), [due_j, spent_j], &rig, "sum of Gc A, Griffith 1921");
    Ok(vec![check(format!("{name}: highest F, N"), [widest_n, highest_n], &rig, source), work])
}

/// Area of the voxels whose middles lie within a circle around a corner of the lattice, m^2.
fn disc_m2(radius_m: f64, voxel_m: f64) -> f64 {
    let reach = (radius_m / voxel_m).ceil() as i32;
    let middle_m = |i: i32| (f64::from(i) + 0.5) * voxel_m;
    let inside = |i: i32| (-reach..reach).filter(|j| middle_m(i).hypot(middle_m(*j)) <= radius_m).count();
    (-reach..reach).map(inside).sum::<usize>() as f64 * voxel_m * voxel_m
}

/// The family.
///
/// # Errors
/// A scene is not valid, a step had a fault, or a held blade did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let (mut checks, width) = widths(extent)?;
    let (rows, slicing) = slices(extent)?;
    checks.extend(rows);
    checks.extend(speeds(extent)?);
    checks.extend(lesion(extent)?);
    if extent == Extent::Full {
        checks.extend(vessel()?);
    }
    let figures = if extent == Extent::Full { vec![width, slicing] } else { Vec::new() };
    Ok(Family {
        title: "Cuts: width, slicing, speed, regions",
        text: TEXT.into(),
        checks,
        figures,
        ..Family::default()
    })
}

const TEXT: &str = "The block is that of the paper's liver in the section before, with k 4 and h 3.5 mm. For slices \
     and speeds h is 7 mm. Slices are in a block twice as wide, which hardly bends along the edge. The force is a \
     mean over 14 mm of travel down, with the edge some 50 mm deep.\n\nAn edge that slides along itself by xi for \
     each 1 that it advances is pushed back against its motion. The force turns over some tens of Gc/E, so it is \
     taken after 49 mm of such travel. The work per area stays Gc. A lesion and a vessel are regions with their own \
     modulus and Gc. Where the edge stands in both materials, the force is the sum of Gc w over its shares. The \
     vessel's work is that of the tool less the change of the stored energy, between two states at rest above and \
     below it. It is compared with Gc times the area swept, plus the vessel's additional Gc times the area of its \
     voxels in it.";
