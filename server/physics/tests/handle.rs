//! The handle of a tool: tissue presses on it as on a probe, and it cuts nothing.

use super::support::cutting::*;
use super::support::{object, scene, world_of};
use kerf_physics::scene::{BladeDesc, CapsuleDesc, GrasperDesc, Scene, ScissorsDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::{ContactModel, Grasp, StepOutput, ToolMotion};
use kerf_physics::{Grid, NoClock, OPEN, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use std::f64::consts::{FRAC_PI_2, PI};

const YOUNG_PA: f64 = 1e5;
const POISSON: f64 = 0.3;
const HEIGHT_M: f64 = 0.01;

/// A block under a probe, its top at y = 0, held at its foot. It rubs, and can be cut.
fn block(half_m: f64, height_m: f64, h: f64, tool: ToolDesc) -> Scene {
    let mut block = object([-half_m, -height_m, -half_m], [half_m, 0.0, half_m], h, 1);
    block.material.young_modulus_pa = YOUNG_PA;
    block.material.poisson_ratio = POISSON;
    block.material.rayleigh_beta_s = 5e-3;
    block.material.friction_coefficient = 0.3;
    block.material.fracture_energy_j_per_m2 = Some(20.0);
    block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * h - height_m, 1.0] }];
    let mut scene = scene(vec![block]);
    scene.desc.tools = vec![tool];
    scene
}

fn with_handle(width_m: f64, handle: CapsuleDesc) -> BladeDesc {
    BladeDesc { handle: Some(handle), ..BladeDesc::straight(width_m, HEIGHT_M) }
}

/// What a world says of a capsule that is pressed down, and then drawn aside along z. The reference pose is `place` in a
/// frame in the middle of the capsule, x along it.
struct Pressed {
    at_rest: StepOutput,
    drawn: StepOutput,
    world: World,
    residual_j: f64,
    work_j: f64,
    friction_j: f64,
}

fn press(mut world: World, place: &Pose, radius_m: f64, depth_m: f64) -> Pressed {
    let (mut residual_j, mut work_j, mut friction_j) = (0.0, 0.0, 0.0);
    let mut go = |y: f64, z: f64| {
        let pose = Pose { position_m: Vec3::new(0.0, y, z) + place.position_m, orientation: place.orientation };
        let inputs = [ToolInput { tool: 0, motion: ToolMotion::move_to(pose) }];
        let inputs = StepInputs { models: &[0], ..StepInputs::of(&inputs) };
        let output = world.step(&Workers::serial(), &NoClock, &inputs).clone();
        assert!(output.fault.is_none(), "{:?}", output.fault);
        residual_j += output.energy.residual_j.abs();
        work_j += output.energy.tool_work_j;
        friction_j += output.energy.friction_j;
        output
    };
    let mut output = go(radius_m + 1e-4, 0.0);
    for i in 0..=60 {
        output = go(radius_m - depth_m * f64::from(i.min(30)) / 30.0, 0.0);
    }
    let at_rest = output.clone();
    for i in 1..=40 {
        output = go(radius_m - depth_m, 5e-5 * f64::from(i));
    }
    Pressed { at_rest, drawn: output, world, residual_j, work_j, friction_j }
}

/// The pose of a tool whose handle has its middle at the origin and lies along x, the rest of the tool at its left; the handle
/// begins `seat_m` from the reference point, from where the tool is turned by `turn_rad` about z.
fn lying_from(seat_m: f64, turn_rad: f64, handle: &CapsuleDesc) -> Pose {
    let middle_m = seat_m + handle.radius_m + 0.5 * handle.length_m;
    let orientation = Quat::from_axis_angle(&Vec3::z_axis(), turn_rad);
    Pose { position_m: -Vec3::x() * middle_m, orientation }
}

fn lying(handle: &CapsuleDesc) -> Pose {
    lying_from(HEIGHT_M, -FRAC_PI_2, handle)
}

/// A tool of every kind that may have this handle, and how it lies.
fn tools_with(handle: &CapsuleDesc) -> [(ToolDesc, Pose); 3] {
    let grasper = GrasperDesc { handle: Some(handle.clone()), ..GrasperDesc::new(0.002) };
    let scissors = ScissorsDesc { handle: Some(handle.clone()), ..ScissorsDesc::new(0.02, 0.005) };
    [
        (ToolDesc::blade("blade", with_handle(0.02, handle.clone())), lying(handle)),
        (ToolDesc::grasper("grasper", grasper), lying_from(0.006, -FRAC_PI_2, handle)),
        (ToolDesc::scissors("scissors", scissors), lying_from(0.0, PI, handle)),
    ]
}

fn along(model: Option<ContactModel>) -> [f64; 9] {
    let stiffness = model.expect("a model of what touches").stiffness;
    std::array::from_fn(|i| stiffness[i / 3][i % 3])
}

#[test]
fn a_handle_is_pressed_back_as_a_probe_of_its_size_in_its_place() {
    // The rest of the tool is off the block, which ends 15 mm to the left.
    for length_m in [0.016, 0.024] {
        let (half_m, radius_m, depth_m) = (0.015, 0.008, 0.001);
        let capsule = CapsuleDesc { radius_m, length_m };
        let scene = block(half_m, 0.015, 0.0025, ToolDesc::probe("probe", capsule.clone()));
        let probe = press(world_of(&scene), &Pose::default(), radius_m, depth_m);
        for (tool, place) in tools_with(&capsule) {
            println!("{}", tool.name);
            let scene = block(half_m, 0.015, 0.0025, tool);
            is_pressed_as(&probe, &press(world_of(&scene), &place, radius_m, depth_m), &place);
        }
    }
}

fn is_pressed_as(probe: &Pressed, handle: &Pressed, place: &Pose) {
    assert_eq!(handle.world.output().topology_version, 0, "it cuts nothing");
    for (own, other) in [(&handle.at_rest, &probe.at_rest), (&handle.drawn, &probe.drawn)] {
        let [own, other] = [own, other].map(|output| output.tools[0]);
        let (force, wanted) = (own.wrench.force_n, other.wrench.force_n);
        println!("  force {force:?}, of a probe {wanted:?}");
        assert!(force.y > 0.1 && (force - wanted).norm() < 1e-3 * wanted.norm(), "{force:?} {wanted:?}");
        // About the edge, which is so far to the left.
        let turned = other.wrench.torque_nm + (-place.position_m).cross(&wanted);
        let arm_nm = wanted.norm() * place.position_m.norm();
        assert!((own.wrench.torque_nm - turned).norm() < 1e-3 * arm_nm, "{:?} {turned:?}", own.wrench.torque_nm);
        // Fields that are refined from step to step are off by some percent.
        let [stiff, wanted] = [own.contact, other.contact].map(along);
        let most = wanted.iter().fold(0.0, |most: f64, k| most.max(k.abs()));
        println!("  stiffness {stiff:.1?}, of a probe {wanted:.1?}");
        assert!(stiff.iter().zip(&wanted).all(|(k, w)| (k - w).abs() < 0.05 * most), "{stiff:?} {wanted:?}");
        let [valid, wanted] = [own.contact, other.contact].map(|model| model.unwrap().validity_radius_m);
        assert!((valid / wanted - 1.0).abs() < 0.05, "{valid} {wanted}");
    }
    assert!((handle.friction_j / probe.friction_j - 1.0).abs() < 1e-3, "{} J", handle.friction_j);
    assert!(handle.residual_j < 1e-3 * handle.work_j, "{} J of {} J", handle.residual_j, handle.work_j);
}

/// The force with which jaws that hold the rim of a block are pressed down with it by 1 mm, and what they do then.
fn pressed_jaws(handle: Option<CapsuleDesc>, max_force_n: Option<f64>) -> (f64, Grasp) {
    let (reach_m, radius_m) = (0.009, 0.008);
    let grasper = GrasperDesc { max_force_n, handle, ..GrasperDesc::new(reach_m) };
    let mut world = world_of(&block(0.03, 0.015, 0.0025, ToolDesc::grasper("grasper", grasper)));
    // Over the block's left rim, the handle lying on its right half.
    let orientation = Quat::from_axis_angle(&Vec3::z_axis(), -FRAC_PI_2);
    let at = |depth_m: f64| Pose { position_m: Vec3::new(-0.028, radius_m - depth_m, 0.0), orientation };
    for step in 0..60 {
        let opening = if step == 0 { OPEN } else { 0.0 };
        let pose = at(0.001 * f64::from(step.min(30)) / 30.0);
        let inputs = [ToolInput { tool: 0, motion: ToolMotion::MoveTo { pose, opening } }];
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
        if output.tools[0].grasp == Grasp::Slipped {
            return (output.tools[0].wrench.force_n.norm(), Grasp::Slipped);
        }
    }
    (world.output().tools[0].wrench.force_n.norm(), world.output().tools[0].grasp)
}

#[test]
fn what_presses_on_a_graspers_handle_tears_nothing_out_of_its_jaws() {
    let handle = Some(CapsuleDesc { radius_m: 0.008, length_m: 0.02 });
    let (held_n, grasp) = pressed_jaws(None, None);
    assert_eq!(grasp, Grasp::Holding);
    let (force_n, grasp) = pressed_jaws(handle.clone(), Some(1.2 * held_n));
    println!("jaws {held_n:.2} N, with the handle {force_n:.2} N");
    assert!(force_n > 1.5 * held_n, "the handle bears too: {force_n} N of {held_n} N");
    assert_eq!(grasp, Grasp::Holding);
    assert_eq!(pressed_jaws(handle, Some(0.5 * held_n)).1, Grasp::Slipped, "but the jaws' own force does");
}

#[test]
fn a_handle_that_is_drawn_aside_is_held_back_by_mu_times_its_normal_force() {
    let capsule = CapsuleDesc { radius_m: 0.008, length_m: 0.02 };
    let [free, rubbed] = [0.0, 0.3].map(|mu| {
        let mut scene = block(0.015, 0.015, 0.0025, ToolDesc::blade("blade", with_handle(0.02, capsule.clone())));
        scene.desc.objects[0].material.friction_coefficient = mu;
        let force_n = press(world_of(&scene), &lying(&capsule), 0.008, 0.001).drawn.tools[0].wrench.force_n;
        -force_n.z / force_n.y
    });
    // What does not rub is held back by the tissue's damping.
    println!("{rubbed:.3} of the normal force, {free:.3} without friction");
    assert!(((rubbed - free) / 0.3 - 1.0).abs() < 0.1, "{rubbed} and {free} of the normal force");
}

#[test]
fn the_end_of_a_handle_is_pressed_back_as_hertz_says() {
    // As `probe_tool::` has it: a block of 12 radii of the dent, 1.06 times as stiff as a half-space.
    let (h, dent_m) = (0.001, 0.0022);
    let (radius_m, depth_m) = (5.0 * dent_m, dent_m / 5.0);
    let scene =
        block(0.014, 0.018, h, ToolDesc::blade("blade", with_handle(0.01, CapsuleDesc { radius_m, length_m: 0.03 })));
    // Upside down, pressed with its far end.
    let middle_m = HEIGHT_M + 2.0 * radius_m + 0.03;
    let orientation = Quat::from_axis_angle(&Vec3::z_axis(), std::f64::consts::PI);
    let place = Pose { position_m: Vec3::new(5e-4, middle_m - radius_m, 4e-4), orientation };
    let force_n = press(world_of(&scene), &place, radius_m, depth_m).at_rest.tools[0].wrench.force_n.y;
    let hertz_n = 4.0 / 3.0 * YOUNG_PA / (1.0 - POISSON * POISSON) * radius_m.sqrt() * depth_m.powf(1.5);
    println!("F/Hertz {:.3}", force_n / hertz_n / 1.06);
    assert!((force_n / hertz_n / 1.06 - 1.0).abs() < 0.08, "{force_n} N against {} N", 1.06 * hertz_n);
}

/// Drives a blade of 10 mm's height into a block, 7 mm deeper than its spine.
fn driven(handle: Option<CapsuleDesc>) -> Rig {
    let mut scene = cutting_scene(super::support::cutting::block(2.5e-3, 1), 0.06, 1000.0);
    scene.desc.tools = vec![ToolDesc::blade("blade", BladeDesc { handle, ..BladeDesc::straight(0.06, HEIGHT_M) })];
    let at = Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4);
    let mut rig = Rig::new(&scene, at, attitude(0.0, 0.0, 0.0), 0.1);
    rig.drive(HEIGHT_M);
    rig.drive(7.5e-3);
    rig.rest(40);
    rig
}

#[test]
fn a_blade_that_goes_in_with_its_handle_meets_more_force_and_cuts_only_with_its_edge() {
    let mut held = driven(Some(CapsuleDesc { radius_m: 0.006, length_m: 0.05 }));
    let bare = driven(None);
    let before = |rig: &Rig| rig.mean_force_n(0.004, 0.009);
    let after = |rig: &Rig| rig.mean_force_n(0.015, 0.018);
    let [held_work_j, bare_work_j] = [&held, &bare].map(|rig| rig.sum(|s| s.energy.tool_work_j));
    let [held_area, bare_area] = [&held, &bare].map(|rig| rig.area_and_work_ratio(GC_J_PER_M2).0);
    let (residual, residual_abs) = held.residual_ratios();
    println!(
        "force {:.2} N and {:.2} N, without {:.2} N and {:.2} N; work {held_work_j:.4} J, without {bare_work_j:.4} J; \
         area {:.2} mm^2, without {:.2} mm^2; residual {residual:.1e} ({residual_abs:.1e})",
        before(&held),
        after(&held),
        before(&bare),
        after(&bare),
        held_area * 1e6,
        bare_area * 1e6
    );
    assert!((before(&held) / before(&bare) - 1.0).abs() < 0.01, "it has not touched yet");
    assert!(after(&held) > 1.2 * after(&bare), "it presses on the rim of the cut");
    assert!(held_work_j > bare_work_j);
    assert!(residual_abs < 0.01, "energy residual {residual} ({residual_abs})");
    // No deeper than the edge, nowhere but in its plane.
    let swept_m2 = BLOCK_SIDE_M * (BLOCK_HEIGHT_M - held.position_m.y);
    assert!((0.95..1.0).contains(&(held_area / swept_m2)), "{held_area} m^2 of {swept_m2} m^2");
    let grid = &held.body().state.grid;
    let mut planes = std::collections::BTreeSet::new();
    for voxel in grid.voxels() {
        for (link, other) in Grid::links_of(voxel.ijk) {
            if grid.voxel_at(other).is_some() && !grid.is_intact(link) {
                planes.insert((link.axis, link.cell[usize::from(link.axis)]));
            }
        }
    }
    assert_eq!(planes.len(), 1, "the planes of all that is parted: {planes:?}");
    // What holds on to nothing feels nothing.
    assert!(held.world.output().tools[0].touches);
    held.lift();
    assert!(!held.world.output().tools[0].touches);
    assert_eq!(held.world.output().tools[0].wrench.force_n, Vec3::zeros());
}

#[test]
fn a_world_with_a_handle_in_tissue_goes_on_from_a_file_with_the_same_bits() {
    let mut own = driven(Some(CapsuleDesc { radius_m: 0.006, length_m: 0.05 }));
    let (file, from_m) = (own.world.save(), own.position_m);
    own.drive(1e-3);
    let hash = own.world.state_hash();
    let mut other = driven(Some(CapsuleDesc { radius_m: 0.006, length_m: 0.05 }));
    other.rest(3);
    other.world.load(&file).unwrap();
    other.position_m = from_m;
    other.drive(1e-3);
    assert_eq!(other.world.state_hash(), hash);
}
