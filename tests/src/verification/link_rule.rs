//! The two fracture rules over mesh sizes: what a blade takes to cut a block by the force-capped front, and by the
//! energy of links.

use std::ops::Range;

use anyhow::{Context, Result};
use kerf_physics::scene::toughness::asked_over_eh;
use kerf_physics::scene::{BladeDesc, FractureRule, Scene, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_plot::{Axis, BLUE, Chart, Curve, Figure, GREEN, RED, RGBColor};
use rayon::prelude::*;

use super::scenes::{Mesh, block, material, scene};
use super::{Extent, Family, Reference, Row, Table};

const SIZE_M: [f64; 3] = [0.02, 0.02, 0.04];
const YOUNG_PA: f64 = 1e6;
const GC_J_PER_M2: f64 = 10.0;
/// Depth of the held layers at the block's ends, m, or an element if that is more: in half an element beside what is held
/// the energy would be as high as in a smaller one.
const HELD_M: f64 = 5e-3;
const SPEED_M_PER_S: f64 = 0.1;
/// The blade's plane from the block's middle, m: beside a face of every mesh's elements.
const ASIDE_M: f64 = 1.5e-4;
/// From above the block to below what hangs through of it.
const STROKE_M: f64 = 0.028;
/// Travel over which the force is averaged, m.
const STEADY_M: Range<f64> = 0.006..0.014;

const RULES: [(FractureRule, &str); 2] = [(FractureRule::Front, "front"), (FractureRule::LinkEnergy, "link energy")];

/// One of a stroke's figures.
type Figured = fn(&Stroke) -> f64;

/// What a stroke took.
#[derive(Clone, Copy, Debug)]
struct Stroke {
    /// Mean force over [`STEADY_M`], the largest, and the largest until the first link parts, over Gc w.
    steady: f64,
    peak: f64,
    start: f64,
    /// Work of the tool over Gc A.
    work: f64,
    /// Pieces it left.
    pieces: f64,
    /// Energy left unexplained, summed over the steps in size, over the work of the tool.
    residual: f64,
}

/// Both rules on the same meshes.
pub struct Comparison {
    meshes: Vec<Mesh>,
    /// By rule, by mesh.
    strokes: [Vec<Stroke>; 2],
}

/// Cuts the block by both rules.
///
/// # Errors
/// A stroke parted nothing.
pub fn compare(extent: Extent) -> Result<Comparison> {
    let all =
        [(4, 2.5e-3), (2, 2.5e-3), (1, 2.5e-3), (4, 1.25e-3), (2, 1.25e-3), (1, 1.25e-3), (4, 6.25e-4), (2, 6.25e-4)];
    let meshes: Vec<Mesh> = extent.of(&all, 2).into_iter().map(|(k, h)| Mesh::new(k, h)).collect();
    let by = |rule: FractureRule| meshes.par_iter().map(|mesh| stroke(*mesh, rule)).collect::<Result<Vec<_>>>();
    let strokes = [by(RULES[0].0)?, by(RULES[1].0)?];
    Ok(Comparison { meshes, strokes })
}

/// A block held at its ends under a blade that reaches over it.
fn scene_of(mesh: Mesh, rule: FractureRule) -> Scene {
    let mut object = block(SIZE_M, mesh, material(YOUNG_PA, 0.45));
    object.fracture_rule = rule;
    object.material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
    object.material.rayleigh_beta_s = 2e-4;
    let held = |from_m: f64, to_m: f64| ShapeDesc::Box { min_m: [-1.0, -1.0, from_m], max_m: [1.0, 1.0, to_m] };
    let held_m = mesh.element_m().max(HELD_M);
    object.fixed = vec![held(-1.0, held_m), held(SIZE_M[2] - held_m, 1.0)];
    let mut scene = scene(object);
    scene.desc.solver.relative_tolerance = Some(1e-3);
    scene.desc.tools = vec![ToolDesc::blade("blade", BladeDesc::straight(0.12, 0.06))];
    scene
}

fn stroke(mesh: Mesh, rule: FractureRule) -> Result<Stroke> {
    let scene = scene_of(mesh, rule).judge()?;
    let mut world = World::new(&scene)?;
    let step_m = SPEED_M_PER_S / scene.desc.rate_hz;
    let (mut steady_n, mut peak_n, mut start_n) = (Vec::new(), 0.0f64, None);
    let (mut work_j, mut area_m2, mut residual_j) = (0.0, 0.0, 0.0);
    for step in 0..(STROKE_M / step_m) as u32 {
        let travel_m = f64::from(step) * step_m;
        let position_m = Vec3::new(0.5 * SIZE_M[0], SIZE_M[1] + 5e-4 - travel_m, 0.5 * SIZE_M[2] + ASIDE_M);
        let motion = ToolMotion::move_to(Pose { position_m, orientation: Quat::identity() });
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
        let force_n = output.tools[0].wrench.force_n.y;
        peak_n = peak_n.max(force_n);
        if output.fracture.parted_links > 0 {
            start_n.get_or_insert(peak_n);
        }
        if STEADY_M.contains(&travel_m) {
            steady_n.push(force_n);
        }
        work_j += output.energy.tool_work_j;
        area_m2 += output.fracture.cut_area_m2;
        residual_j += output.energy.residual_j.abs();
    }
    let gc_w = GC_J_PER_M2 * SIZE_M[0];
    Ok(Stroke {
        steady: steady_n.iter().sum::<f64>() / steady_n.len() as f64 / gc_w,
        peak: peak_n / gc_w,
        start: start_n.context("no link parted")? / gc_w,
        work: work_j / (GC_J_PER_M2 * area_m2),
        pieces: f64::from(world.bodies()[0].part_count()),
        residual: residual_j / work_j,
    })
}

impl Comparison {
    /// The comparison as cases of the document.
    #[must_use]
    pub fn family(&self) -> Family {
        let row = |case: String, reference: Reference, source: &str, ours: Vec<f64>| Row {
            case,
            reference,
            ours,
            source: source.into(),
        };
        let one = Reference::Value(1.0, "");
        let mut rows = Vec::new();
        for ((_, name), strokes) in RULES.iter().zip(&self.strokes) {
            let of = |value: Figured| strokes.iter().map(value).collect::<Vec<_>>();
            rows.push(row(format!("{name}: steady F / Gc w"), one, "Griffith 1921", of(|s| s.steady)));
            rows.push(row(format!("{name}: largest F / Gc w"), one, "Griffith 1921", of(|s| s.peak)));
            rows.push(row(format!("{name}: work of the tool / Gc A"), one, "Griffith 1921", of(|s| s.work)));
            let two = Reference::Value(2.0, "");
            rows.push(row(format!("{name}: pieces after the stroke"), two, "", of(|s| s.pieces)));
            let case = format!("{name}: energy residual over the work of the tool");
            rows.push(row(case, Reference::AtMost(0.01), "", of(|s| s.residual)));
        }
        let starts = self.meshes.iter().zip(&self.strokes[1]).map(|(mesh, stroke)| {
            let scene = scene_of(*mesh, FractureRule::LinkEnergy);
            let material = &scene.desc.objects[0].material;
            let asked = asked_over_eh(material, FractureRule::LinkEnergy, mesh.voxel_m, mesh.level);
            stroke.start * GC_J_PER_M2 / (asked.unwrap_or(f64::NAN) * YOUNG_PA * mesh.element_m())
        });
        let case = "link energy: first F / w over c_k H (2 E Gc / h)^1/2".into();
        rows.push(row(case, one, "scaling; c_k as the scene check has it", starts.collect()));
        Family {
            title: "Two fracture rules",
            text: self.text(),
            tables: vec![Table { columns: self.meshes.iter().map(Mesh::name).collect(), rows }],
            studies: Vec::new(),
            checks: Vec::new(),
            figures: Vec::new(),
        }
    }

    fn text(&self) -> String {
        let of = |rule: usize, value: Figured| {
            let values = self.strokes[rule].iter().map(value);
            let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
            format!("{low:.3} to {high:.3}")
        };
        format!(
            "A blade of 50 um goes through a block of 20 x 20 x 40 mm (E 1 MPa, nu 0.45, Gc 10 J/m^2) that is fixed \
             at its ends. It cuts once by the force-capped front and once by `fracture_rule = \"link_energy\"`, the \
             rule of He et al. (2022). Under that rule a link is cut where the elastic energy Psi of its element \
             reaches Gc / h. That is their Eq. 6 with kappa = Gc / h, so that both sides have one unit. Steady is the \
             mean over a travel of 6 to 14 mm.\n\nThe front takes {} Gc w steadily and {} Gc per area on every mesh. \
             Its largest force is within 2 % of the steady one. By the energy of links the same cut takes {} Gc w and \
             {} Gc per area, because its load strains a composite element to Psi. That load is of the order of H (2 E \
             Gc / h)^1/2 and grows with the level. It does not converge to Griffith's balance under refinement. At k \
             4 and the finest voxels a link is still uncut after the stroke. The rest of the work goes into the \
             springs and the strain that each link releases.\n\n![Force and work of a cut by both rules over the size \
             of a voxel](verification-link-rule.png)",
            of(0, |s| s.steady),
            of(0, |s| s.work),
            of(1, |s| s.steady),
            of(1, |s| s.work),
        )
    }

    /// `verification-link-rule`: what a stroke takes over the edge of a voxel, by rule and k.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let panels: [(&str, Figured); 3] =
            [("steady F / (Gc w)", |s| s.steady), ("largest F / (Gc w)", |s| s.peak), ("work / (Gc A)", |s| s.work)];
        let charts = panels.into_iter().map(|(title, value)| self.chart(title, value)).collect();
        Figure::row("verification-link-rule", "Cutting a block by two rules", charts).sized((1380, 560))
    }

    fn chart(&self, title: &str, value: Figured) -> Chart {
        let mut curves = Vec::new();
        for ((_, rule), strokes) in RULES.iter().zip(&self.strokes) {
            for (k, colour) in COLOURS {
                let of_k = self.meshes.iter().zip(strokes).filter(|(mesh, _)| mesh.k() == k);
                let points = of_k.map(|(mesh, stroke)| (1e3 * mesh.voxel_m, value(stroke))).collect();
                let label = format!("{rule}, k = {k}");
                // What lies on top of another must not hide it: the front's rings grow with k.
                let curve = match *rule == RULES[0].1 {
                    true => Curve::ringed_line(&label, points, 3 + k as i32),
                    false => Curve::dotted_line(&label, points),
                };
                curves.push(curve.coloured(colour));
            }
        }
        let (x, y) = (Axis::log("edge of a voxel h, mm").over(0.5..3.2), Axis::log(title).over(0.5..1000.0));
        Chart::new(x, y, curves)
    }
}

/// By k.
const COLOURS: [(u32, RGBColor); 3] = [(1, BLUE), (2, RED), (4, GREEN)];
