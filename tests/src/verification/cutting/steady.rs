//! Steady cuts on many meshes, planes and places, in the paper's materials and in real ones.

use anyhow::{Context, Result};
use kerf_physics::scene::MaterialDesc;
use kerf_plot::{Axis, Chart, Curve, Figure};
use kerf_scenes::catalog;
use rayon::prelude::*;

use super::stroke::{EDGE_HALF_WIDTH_M, Outcome, Plane, Stroke, Support, gc};
use crate::verification::scenes::Mesh;
use crate::verification::{Check, Extent, Family};

/// Largest error of forces and energy release rates.
const FORCE_LIMIT: f64 = 0.05;
/// Largest error of the work per area, in materials as stiff as the paper's and in tissue.
const WORK_LIMIT: f64 = 0.03;
const TISSUE_WORK_LIMIT: f64 = 0.06;
/// Moduli below this are those of tissue, Pa.
const TISSUE_PA: f64 = 5e5;
/// The coarsest voxel, m: twice that of the liver's scenes.
const COARSE_M: f64 = 7e-3;

/// Young's moduli of the paper's Table 1, Pa, by the scene that is of the material.
const TABLE_1_PA: [(&str, f64); 6] =
    [("gummy-bear", 2.0e6), ("jelly", 1.0e6), ("tofu", 2.5e6), ("rubber", 8.0e6), ("cuboid", 1.5e6), ("liver", 2.0e6)];
/// Scenes of materials as measured.
const MEASURED: [&str; 5] = ["skin", "gelatine", "potato", "cucumber", "apple"];

/// The material of a built-in scene at rates too slow to toughen it, with its voxels and level.
fn material(scene: &str) -> Result<(MaterialDesc, Mesh)> {
    let object = catalog::builtin(scene)?.into_scene().desc.objects.remove(0);
    let mesh = Mesh { voxel_m: object.voxel_size_m.unwrap_or(COARSE_M), level: object.level };
    Ok((MaterialDesc { rate: None, ..object.material }, mesh))
}

/// The block of the paper's liver.
pub(super) fn liver(k: u32, voxel_m: f64) -> Result<Stroke> {
    Ok(Stroke::through(material("liver")?.0, Mesh::new(k, voxel_m), COARSE_M, 24.0))
}

/// The block of real liver, of two elements at least across.
fn tissue(k: u32, voxel_m: f64) -> Result<Stroke> {
    let mesh = Mesh::new(k, voxel_m);
    let regions = catalog::builtin("liver-tissue")?.into_scene().desc.objects.remove(0).regions;
    let parenchyma = regions.into_iter().find(|region| region.name == "parenchyma").context("no parenchyma")?;
    let stroke = Stroke::through(parenchyma.material, mesh, COARSE_M.max(0.25 * mesh.element_m()), 32.0);
    Ok(Stroke { speed_m_per_s: 0.1, rate_hz: 500.0, ..stroke })
}

/// A stroke and what is said of it.
struct Case {
    name: String,
    stroke: Stroke,
    /// Whether the force that starts the cut is a row.
    starts: bool,
}

impl Case {
    fn of_mesh(name: &str, stroke: Stroke) -> Self {
        let name = format!("{name}, {}, {} ms", stroke.mesh.name(), 1e3 / stroke.rate_hz);
        Self { name, stroke, starts: false }
    }

    fn checks(&self, outcome: &Outcome) -> Vec<Check> {
        let is_tissue = self.stroke.material.young_modulus_pa < TISSUE_PA;
        let work_limit = if is_tissue { TISSUE_WORK_LIMIT } else { WORK_LIMIT };
        let row = |what: &str, ours: f64, limit: Option<f64>, source: &'static str| Check {
            case: format!("{}: {what}", self.name),
            reference: 1.0,
            ours,
            limit,
            residual: Some(outcome.steady.residual),
            source,
        };
        let check = |what: &str, ours: f64, limit: f64, source| row(what, ours, Some(limit), source);
        let read = |what: &str, ours: f64, source| row(what, ours, None, source);
        let mut checks = vec![
            // From states at rest: nothing of the front's own law can make it come out right.
            check("-dPi/dA at constant force / Gc", outcome.release, FORCE_LIMIT, "Irwin, Kies 1954"),
            check("-dU/dA at a held blade / Gc", outcome.held_release, FORCE_LIMIT, "Griffith 1921"),
            // These follow from the cap of the front's force, and show that it is applied.
            check("F / Gc w", outcome.steady.force, FORCE_LIMIT, "F = Gc w, Griffith 1921; Atkins 2009"),
            read("work of the capped force / Gc A", outcome.front_work, "the blade's part of Gc A"),
        ];
        checks.push(check(
            "work of the tool less stored, less initiation / Gc A",
            outcome.tool_work,
            work_limit,
            "Griffith 1921",
        ));
        if self.stroke.is_strained() {
            let what = "steady work of the tool less stored / Gc A";
            checks.push(check(what, outcome.steady.work, work_limit, "Griffith 1921"));
        }
        if self.starts {
            let source = "the material's initiation ratio";
            checks.push(check("highest F / 2 Gc w", outcome.highest, FORCE_LIMIT, source));
        }
        checks
    }
}

/// Voxels along an element's edge and the voxel over the coarsest one, from coarse to fine; at a quarter of it the
/// elements of k = 2 are left out.
const MESHES: [(u32, f64); 8] = [(4, 1.0), (8, 1.0), (2, 1.0), (2, 0.5), (4, 0.5), (8, 0.5), (4, 0.25), (8, 0.25)];

/// Sizes with every k, at dt and, but for the finest, dt/2.
fn meshes(extent: Extent) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for (k, share) in extent.of(&MESHES, 2) {
        let halves = if extent == Extent::Full && share > 0.25 { vec![1.0, 2.0] } else { vec![1.0] };
        for half in halves {
            let stroke = liver(k, share * COARSE_M)?;
            cases.push(Case::of_mesh("liver", Stroke { rate_hz: half * stroke.rate_hz, ..stroke }));
        }
    }
    // Real liver without the finest elements.
    for (k, share) in extent.of(&MESHES, 1).into_iter().filter(|m| *m != (4, 0.25) && *m != (2, 0.5)) {
        let halves = if extent == Extent::Full && share == 1.0 { vec![1.0, 2.0] } else { vec![1.0] };
        for half in halves {
            let stroke = tissue(k, share * COARSE_M)?;
            cases.push(Case::of_mesh("real liver", Stroke { rate_hz: half * stroke.rate_hz, ..stroke }));
        }
    }
    Ok(cases)
}

/// Planes, places of the blade among the nodes, penalties and edges; on the scene's mesh.
fn variations(extent: Extent) -> Result<Vec<Case>> {
    let voxel_m = if extent == Extent::Full { 0.5 * COARSE_M } else { COARSE_M };
    let base = liver(4, voxel_m)?;
    let edge_m = base.mesh.element_m();
    let case = |name: String, stroke: Stroke| Case { name, stroke, starts: false };
    let mut cases = Vec::new();
    for plane in [Plane::Oblique, Plane::Diagonal] {
        // The oblique blade goes on along x as far as down.
        let length_m = if plane == Plane::Oblique { 24.0 * COARSE_M } else { base.size_m[0] };
        let [_, height_m, width_m] = base.size_m;
        let stroke = Stroke { plane, size_m: [length_m, height_m, width_m], ..base.clone() };
        cases.push(case(format!("liver, plane {}", plane.name()), stroke));
    }
    if extent == Extent::Coarse {
        return Ok(cases);
    }
    for (place, share) in [
        ("on a node plane", 0.0),
        ("an eighth of an element off, through voxel centres", 0.125),
        ("a third of an element off", 1.0 / 3.0),
        ("half an element off, between voxels", 0.5),
    ] {
        cases.push(case(format!("liver, blade {place}"), Stroke { off_m: share * edge_m, ..base.clone() }));
    }
    for penalty_factor in [0.1, 1.0, 10.0] {
        let stroke = Stroke { penalty_factor, off_m: edge_m / 3.0, ..base.clone() };
        cases.push(Case { starts: true, ..case(format!("liver, contact penalties x {penalty_factor}"), stroke) });
    }
    for factor in [0.1, 10.0] {
        let stroke = Stroke { edge_half_width_m: factor * EDGE_HALF_WIDTH_M, ..base.clone() };
        cases.push(Case {
            starts: true,
            ..case(format!("liver, edge of {} um", 1e6 * stroke.edge_half_width_m), stroke)
        });
    }
    Ok(cases)
}

/// Every material of the paper's Table 1, and those that were measured, on the voxels and level of their scenes.
fn materials(extent: Extent) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for scene in TABLE_1_PA.iter().map(|t| t.0).chain(MEASURED).filter(|_| extent == Extent::Full) {
        let (material, mesh) = material(scene)?;
        // Blocks that are large beside the dent.
        let is_soft = gc(&material) / material.young_modulus_pa > 0.1 * mesh.voxel_m;
        let unit_m = if is_soft { 2.0 * mesh.voxel_m } else { mesh.voxel_m };
        let stroke = Stroke::through(material, mesh, unit_m, 32.0);
        cases.push(Case { name: format!("{scene}, {}", mesh.name()), stroke, starts: false });
    }
    Ok(cases)
}

/// Bars of real liver that are held at their bottom alone: the force squeezes all of what is below the front. Four
/// times as wide along the edge as the other blocks, so that they do not buckle.
fn bars(extent: Extent) -> Result<Vec<Check>> {
    let run = |(k, voxel_m): &(u32, f64)| {
        let base = tissue(*k, *voxel_m)?;
        let [length_m, height_m, width_m] = base.size_m;
        let stroke = Stroke { size_m: [length_m, height_m, 4.0 * width_m], support: Support::Bottom, ..base };
        let steady = stroke.run_steady()?;
        let row = |what: &str, [reference, ours]: [f64; 2], limit: f64, source: &'static str| Check {
            case: format!("bar of real liver, {}: {what}", stroke.mesh.name()),
            reference,
            ours,
            limit: Some(limit),
            residual: Some(steady.residual),
            source,
        };
        let force = [stroke.bar_force(), steady.force];
        Ok([
            row("F / Gc w", force, FORCE_LIMIT, "F lambda + U A = Gc w, as Rivlin, Thomas 1953"),
            row("steady work of the tool less stored / Gc A", [1.0, steady.work], TISSUE_WORK_LIMIT, "Griffith 1921"),
        ])
    };
    let meshes = extent.of(&[(4, COARSE_M), (8, 0.5 * COARSE_M), (4, 0.5 * COARSE_M)], 1);
    Ok(meshes.par_iter().map(run).collect::<Result<Vec<_>>>()?.into_iter().flatten().collect())
}

/// The moduli of the scenes against the paper's.
fn moduli() -> Result<Vec<Check>> {
    TABLE_1_PA
        .iter()
        .map(|(scene, young_modulus_pa)| {
            Ok(Check {
                case: format!("{scene}: Young's modulus, Pa"),
                reference: *young_modulus_pa,
                ours: material(scene)?.0.young_modulus_pa,
                limit: Some(0.0),
                residual: None,
                source: "Table 1 of the paper",
            })
        })
        .collect()
}

/// The family.
///
/// # Errors
/// A scene is not valid, a step had a fault, or a held blade did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let mut cases = meshes(extent)?;
    cases.extend(variations(extent)?);
    cases.extend(materials(extent)?);
    let outcomes = cases.par_iter().map(|case| case.stroke.run()).collect::<Result<Vec<_>>>()?;
    let mut checks: Vec<Check> = cases.iter().zip(&outcomes).flat_map(|(case, outcome)| case.checks(outcome)).collect();
    checks.extend(bars(extent)?);
    checks.extend(moduli()?);
    let figures = if extent == Extent::Full { vec![force_by_depth(&cases, &outcomes)] } else { Vec::new() };
    Ok(Family { title: "Steady cuts", text: TEXT.trim_end().into(), checks, figures, ..Family::default() })
}

/// Force by depth on the three sizes at k = 4.
fn force_by_depth(cases: &[Case], outcomes: &[Outcome]) -> Figure {
    let is_shown = |case: &Case| case.name.starts_with("liver, k 4, h") && case.name.ends_with(" 1 ms");
    let shown = cases.iter().zip(outcomes).filter(|(case, _)| is_shown(case));
    let curve = |(case, outcome): (&Case, &Outcome)| {
        let label = format!("h {} mm", 1e3 * case.stroke.mesh.voxel_m);
        Curve::line(&label, outcome.curve.iter().map(|p| (1e3 * p.0, p.1)).collect())
    };
    Figure::new(
        "verification-cut",
        "A straight edge into a block of the paper's liver, k = 4",
        Chart::new(Axis::linear("way of the edge, mm"), Axis::linear("force over Gc w"), shown.map(curve).collect()),
    )
}

const TEXT: &str = include_str!("steady.md");
