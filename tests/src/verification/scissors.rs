//! Scissors close on a strip: what the cut costs and how much of it is booked, against the strip's section.

use anyhow::{Result, ensure};
use kerf_physics::scene::{ScissorsDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::{EnergyStep, ToolMotion};
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use rayon::prelude::*;

use super::scenes::{Mesh, block, material, scene};
use super::{Check, Extent, Family};

/// Side of the strip's square section, its length and what is held at each end, m.
const SIDE_M: f64 = 0.01;
const LENGTH_M: f64 = 0.04;
const HELD_M: f64 = 0.005;
const GC_J_PER_M2: f64 = 100.0;
/// From the scissors' pivot to the middle of the strip, and the length and height of the blades, m.
const REACH_M: f64 = 0.025;
const BLADE_M: [f64; 2] = [0.05, 0.02];
/// Steps of 1 ms in which they close.
const CLOSING_STEPS: u32 = 800;
const LIMIT: f64 = 0.1;

/// The plane that the blades move in: how far it is from the middle of the strip along it, m, and by how much it is
/// tilted about the blades, and turned about the vertical.
#[derive(Clone, Copy, Debug)]
struct Plane {
    name: &'static str,
    offset_m: f64,
    tilt_deg: f64,
    turn_deg: f64,
}

const PLANES: [Plane; 4] = [
    Plane { name: "across", offset_m: 3e-4, tilt_deg: 0.0, turn_deg: 0.0 },
    Plane { name: "across between voxels", offset_m: 0.0, tilt_deg: 0.0, turn_deg: 0.0 },
    Plane { name: "tilted by 30 deg", offset_m: 3e-4, tilt_deg: 30.0, turn_deg: 0.0 },
    Plane { name: "turned by 30 deg", offset_m: 3e-4, tilt_deg: 0.0, turn_deg: 30.0 },
];

impl Plane {
    /// Area of the strip's section by it, m^2.
    fn area_m2(self) -> f64 {
        SIDE_M * SIDE_M / (self.tilt_deg.to_radians().cos() * self.turn_deg.to_radians().cos())
    }

    fn pose(self) -> Pose {
        let orientation = Quat::from_axis_angle(&Vec3::y_axis(), self.turn_deg.to_radians())
            * Quat::from_axis_angle(&Vec3::x_axis(), self.tilt_deg.to_radians());
        Pose { position_m: Vec3::z() * self.offset_m - orientation * Vec3::x() * REACH_M, orientation }
    }
}

/// What closing the scissors came to.
#[derive(Clone, Copy, Debug, Default)]
struct Cut {
    booked: EnergyStep,
    residual_j: f64,
    area_m2: f64,
}

fn cut(mesh: Mesh, plane: Plane) -> Result<Cut> {
    let mut desc = block([1.0; 3], mesh, material(1e6, 0.45));
    let (half_m, end_m) = (0.5 * SIDE_M, 0.5 * LENGTH_M);
    desc.shape = ShapeDesc::Box { min_m: [-half_m, -half_m, -end_m], max_m: [half_m, half_m, end_m] };
    desc.material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
    desc.material.rayleigh_beta_s = 5e-4;
    desc.fixed = [(-1.0, HELD_M - end_m), (end_m - HELD_M, 1.0)]
        .map(|(from_m, to_m)| ShapeDesc::Box { min_m: [-1.0, -1.0, from_m], max_m: [1.0, 1.0, to_m] })
        .to_vec();
    let mut scene = scene(desc);
    scene.desc.solver.relative_tolerance = Some(1e-3);
    scene.desc.tools = vec![ToolDesc::scissors("scissors", ScissorsDesc::new(BLADE_M[0], BLADE_M[1]))];
    let mut world = World::new(&scene.judge()?)?;
    let mut cut = Cut::default();
    let pose = plane.pose();
    let closing = (1..=CLOSING_STEPS)
        .map(|step| ToolMotion::MoveTo { pose, opening: 1.0 - f64::from(step) / f64::from(CLOSING_STEPS) });
    for motion in std::iter::once(ToolMotion::enter_at(pose)).chain(closing) {
        let inputs = [ToolInput { tool: 0, motion }];
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        ensure!(output.fault.is_none(), "step {}: {:?}", output.step, output.fault);
        cut.booked.book(&output.energy);
        cut.residual_j += output.energy.residual_j.abs();
        cut.area_m2 += output.fracture.cut_area_m2;
    }
    Ok(cut)
}

fn checks(mesh: Mesh, plane: Plane, cut: &Cut) -> [Check; 3] {
    let energy = &cut.booked;
    let gc_a_j = GC_J_PER_M2 * plane.area_m2();
    let stored_j = energy.elastic_j + energy.contact_j + energy.kinetic_j;
    let check = |what: &str, ours: f64, limit: Option<f64>, source: &'static str| Check {
        case: format!("{}, {}: {what}", mesh.name(), plane.name),
        reference: 1.0,
        ours,
        limit,
        residual: Some(cut.residual_j / energy.tool_work_j),
        source,
    };
    [
        check("area booked / section", cut.area_m2 / plane.area_m2(), Some(LIMIT), "geometry"),
        check(
            "work of the fronts / Gc A",
            (energy.fracture_j + energy.front_slip_j) / gc_a_j,
            Some(LIMIT),
            "Griffith 1921",
        ),
        check(
            "work of the scissors less stored / Gc A",
            (energy.tool_work_j - stored_j) / gc_a_j,
            None,
            "Griffith 1921",
        ),
    ]
}

/// The family.
///
/// # Errors
/// A step had a fault.
pub fn family(extent: Extent) -> Result<Family> {
    let meshes = [(4, 0.625e-3), (2, 1e-3), (4, 1.25e-3), (2, 1.25e-3)].map(|(k, h)| Mesh::new(k, h));
    let meshes = extent.of(&meshes, 1);
    let planes = extent.of(&PLANES, 1);
    let runs: Vec<_> = meshes.iter().flat_map(|mesh| planes.iter().map(|plane| (*mesh, *plane))).collect();
    let found = runs.par_iter().map(|(mesh, plane)| cut(*mesh, *plane)).collect::<Result<Vec<_>>>()?;
    Ok(Family {
        title: "Scissors",
        text: format!(
            "Two edges that pivot close in {CLOSING_STEPS} ms on a strip of 10 x 10 x 40 mm (E 1 MPa, nu 0.45, Gc \
             {GC_J_PER_M2} J/m^2) that is fixed at its ends. They cut it from both sides until the cuts meet. A is \
             the area of the strip's section by the plane of the blades, not the booked area. The plane lies across \
             the strip, or is tilted about the blades, or turned about the vertical. The fronts' work is that of \
             their capped force. The work of the scissors also contains the energy that went into damping and \
             numerical loss, as both edges dropped from twice Gc w and as the last ligament snapped."
        ),
        checks: runs.iter().zip(&found).flat_map(|((mesh, plane), cut)| checks(*mesh, *plane, cut)).collect(),
        ..Family::default()
    })
}
