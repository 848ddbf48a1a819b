//! Scissors close on tissue and cut it.

use super::support::{object, scene, world_of};
use kerf_physics::scene::{Scene, ScissorsDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::{EnergyStep, StepOutput, ToolMotion};
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

const GC_J_PER_M2: f64 = 100.0;
const SIDE_M: f64 = 0.01;

/// A strip along z, held at both ends, between open scissors whose blades lie along x across it.
fn strip(h: f64, level: u8) -> Scene {
    let half = 0.5 * SIDE_M;
    let mut strip = object([-half, -half, -0.02], [half, half, 0.02], h, level);
    strip.material.young_modulus_pa = 1e6;
    strip.material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
    strip.material.rayleigh_beta_s = 5e-4;
    let end = |min_m, max_m| ShapeDesc::Box { min_m, max_m };
    strip.fixed = vec![end([-1.0, -1.0, -1.0], [1.0, 1.0, -0.017]), end([-1.0, -1.0, 0.017], [1.0, 1.0, 1.0])];
    let mut scene = scene(vec![strip]);
    scene.desc.solver.relative_tolerance = Some(1e-3);
    scene.desc.tools = vec![ToolDesc::scissors("scissors", ScissorsDesc::new(0.05, 0.02))];
    scene
}

/// The pivot is 25 mm to the left of the strip; the blades' plane is none of the voxels'.
fn pose() -> Pose {
    Pose { position_m: Vec3::new(-0.025, 0.0, 3e-4), orientation: Quat::identity() }
}

fn opened_by(opening: f64) -> ToolMotion {
    ToolMotion::MoveTo { pose: pose(), opening }
}

struct Cut {
    world: World,
    booked: EnergyStep,
    residual_j: f64,
    area_m2: f64,
    parted: u32,
}

impl Cut {
    fn act(&mut self, motion: ToolMotion) -> StepOutput {
        let inputs = [ToolInput { tool: 0, motion }];
        let output = self.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs)).clone();
        assert!(output.fault.is_none(), "{:?}", output.fault);
        self.booked.tool_work_j += output.energy.tool_work_j;
        self.booked.fracture_j += output.energy.fracture_j;
        self.booked.front_slip_j += output.energy.front_slip_j;
        self.residual_j += output.energy.residual_j.abs();
        self.area_m2 += output.fracture.cut_area_m2;
        self.parted += output.fracture.parted_links;
        output
    }
}

/// Closes scissors at `pose` about the strip in `steps` steps; the largest force across, N.
fn close(scene: &Scene, pose: Pose, steps: u32) -> (Cut, f64) {
    let world = world_of(scene);
    let mut cut = Cut { world, booked: EnergyStep::default(), residual_j: 0.0, area_m2: 0.0, parted: 0 };
    cut.act(ToolMotion::enter_at(pose));
    let mut lift: f64 = 0.0;
    for i in 1..=steps {
        let opening = 1.0 - f64::from(i) / f64::from(steps);
        let output = cut.act(ToolMotion::MoveTo { pose, opening });
        lift = lift.max(output.tools[0].wrench.force_n.y.abs());
    }
    (cut, lift)
}

#[test]
fn closing_parts_the_strip_by_two_cuts_that_meet() {
    for (h, level) in [(0.00125, 1), (0.00125, 2)] {
        let (mut cut, lift) = close(&strip(h, level), pose(), 800);
        let body = cut.world.bodies()[0];
        assert!(body.part_count() >= 2, "{} parts", body.part_count());
        let share = cut.area_m2 / (SIDE_M * SIDE_M);
        let work = (cut.booked.fracture_j + cut.booked.front_slip_j) / (GC_J_PER_M2 * cut.area_m2);
        let residual = cut.residual_j / cut.booked.tool_work_j;
        println!(
            "h {h} level {level}: {} links, area/section {share:.3}, work/(Gc A) {work:.3}, residual/work {residual:.1e}, \
             lift {lift:.3} N",
            cut.parted
        );
        assert!((share - 1.0).abs() < 0.04, "{share}");
        assert!((work - 1.0).abs() < 0.04, "{work}");
        assert!(residual < 1e-2, "{residual}");
        // The two edges press against each other: next to nothing is left on the hand but the squeeze along
        // the blades.
        assert!(lift < 0.3 * GC_J_PER_M2 * SIDE_M, "{lift}");
        let opened = cut.act(opened_by(1.0));
        assert_eq!(opened.tools[0].cutting_length_m, 0.0);
    }
}

#[test]
fn what_closing_cuts_is_the_section_on_any_mesh_and_plane() {
    // Voxel and level; where the blades meet over the strip's middle, and their plane over it, m; yaw and roll of the
    // plane. On meshes of four and five elements across, and on planes of 45 degrees, the two ends of the cut in the skin
    // are worth more of it.
    let cases = [
        (0.00125, 1, [0.0, 9e-4], [0.0, 0.0], 0.04),
        (0.00125, 1, [6e-4, 3e-4], [0.0, 0.0], 0.04),
        (0.00125, 2, [3e-4, 3e-4], [0.2, 0.0], 0.04),
        (0.0025, 0, [0.0, 3e-4], [0.0, 0.3], 0.09),
        (0.0025, 0, [4e-4, 7e-4], [0.5, 0.3], 0.09),
        (0.00125, 1, [0.0, 3e-4], [0.5, 0.785], 0.06),
        (0.0025, 0, [4e-4, 3e-4], [0.0, 0.785], 0.12),
    ];
    for (h, level, [y, z], [yaw, roll], most) in cases {
        let pose = Pose { position_m: Vec3::new(-0.025, y, z), orientation: Quat::from_euler_angles(roll, yaw, 0.0) };
        let (cut, _) = close(&strip(h, level), pose, 400);
        let section_m2 = SIDE_M * SIDE_M / (f64::cos(yaw) * f64::cos(roll));
        let (area, work) = (cut.area_m2 / section_m2, cut.booked.tool_work_j / (GC_J_PER_M2 * section_m2));
        println!(
            "h {h} level {level} y {y} z {z} yaw {yaw} roll {roll}: area/section {area:.3}, work/(Gc section) {work:.3}"
        );
        assert!((area - 1.0).abs() < most, "{area}");
        assert!((work - 1.0).abs() < most, "{work}");
        assert!(cut.world.bodies()[0].part_count() >= 2);
    }
}

#[test]
fn two_edges_squeeze_the_tissue_out_towards_the_tips() {
    // Before they give: each edge presses along its own normal, which leans towards the tips.
    let scene = strip(0.00125, 1);
    let mut world = world_of(&scene);
    let mut act =
        |motion| world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }])).clone();
    act(ToolMotion::enter_at(pose()));
    let mut wrench = None;
    for i in 1..=400 {
        let output = act(opened_by(1.0 - f64::from(i) / 800.0));
        assert_eq!(output.fracture.parted_links, 0, "at {i}");
        let force = output.tools[0].wrench.force_n;
        if force.norm() > 0.05 {
            wrench = Some(output.tools[0].wrench);
            break;
        }
    }
    let wrench = wrench.expect("they touch");
    // On the tool: back towards the pivot, no lift, no torque about it.
    assert!(wrench.force_n.x < 0.0 && wrench.force_n.y.abs() < 0.1 * wrench.force_n.x.abs(), "{wrench:?}");
    assert!(wrench.torque_nm.z.abs() < 0.1 * 0.02 * wrench.force_n.x.abs(), "{wrench:?}");
}
