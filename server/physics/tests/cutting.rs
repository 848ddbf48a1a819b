//! A blade cuts a block: force, work and area against Griffith's rule, on several meshes and planes.

use super::support::cutting::*;
use kerf_physics::Vec3;

const SPEED_M_PER_S: f64 = 0.1;
/// Start of a stroke above the block.
const CLEARANCE_M: f64 = 5e-4;

/// A mesh, a plane through it and a step rate.
#[derive(Clone, Copy)]
struct Setup {
    /// Edge of a voxel, m.
    h_m: f64,
    level: u8,
    /// Turn of the blade, degrees: about the scene's y, about the blade's normal, about its edge.
    yaw_deg: f64,
    roll_deg: f64,
    pitch_deg: f64,
    /// Distance of the plane from the block's middle, m.
    off_m: f64,
    rate_hz: f64,
}

impl Default for Setup {
    fn default() -> Self {
        Self { h_m: 2.5e-3, level: 2, yaw_deg: 0.0, roll_deg: 0.0, pitch_deg: 0.0, off_m: 0.0, rate_hz: 1000.0 }
    }
}

fn rig(Setup { h_m, level, yaw_deg, roll_deg, pitch_deg, off_m, rate_hz }: Setup) -> Rig {
    let scene = cutting_scene(block(h_m, level), 0.12, rate_hz);
    let orientation = attitude(yaw_deg, roll_deg, pitch_deg);
    let forward = orientation * -Vec3::y();
    let normal = orientation * Vec3::z();
    // Through the block's middle, `off_m` beside it; the edge starts clear of the block.
    let middle = Vec3::new(0.0, 0.5 * BLOCK_HEIGHT_M, 0.0) + normal * off_m;
    let half = Vec3::new(0.5 * BLOCK_SIDE_M, 0.5 * BLOCK_HEIGHT_M, 0.5 * BLOCK_SIDE_M);
    let reach = (0..3).map(|a| half[a] * forward[a].abs()).sum::<f64>() + CLEARANCE_M;
    Rig::new(&scene, middle - forward * reach, orientation, SPEED_M_PER_S)
}

fn report(name: &str, rig: &Rig, force_ratio: f64) {
    let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
    let tool = rig.sum(|s| s.energy.tool_work_j);
    let share = |term: fn(&Sample) -> f64| rig.sum(term) / tool;
    let (residual, residual_abs) = rig.residual_ratios();
    println!(
        "{name}: F/(Gc w) {force_ratio:.3}, highest {:.3} N, work/(Gc A) {work:.3}, A {area:.3e} m^2; of the tool's \
         work: fracture {:.3} slip {:+.3} initiation {:.3} damping {:.3} parting {:+.4} contact {:+.4} numerical {:+.4} residual {residual:+.1e} ({residual_abs:.1e})",
        rig.highest_force_n(),
        share(|s| s.energy.fracture_j),
        share(|s| s.energy.front_slip_j),
        share(|s| s.energy.initiation_j),
        share(|s| s.energy.damping_j),
        share(|s| s.energy.parting_j),
        share(|s| s.energy.contact_loss_j),
        share(|s| s.energy.numerical_j),
    );
}

#[test]
fn steady_cutting_takes_gc_per_width_and_gc_per_area_on_every_mesh() {
    // Off the node planes by a fraction of a voxel that differs between the meshes.
    for setup in [
        Setup { off_m: 4e-4, ..Setup::default() },
        Setup { off_m: 4e-4, rate_hz: 2000.0, ..Setup::default() },
        Setup { off_m: 5e-3, ..Setup::default() },
        Setup { level: 1, off_m: -9e-4, ..Setup::default() },
        Setup { h_m: 1.25e-3, off_m: 1.7e-3, ..Setup::default() },
    ] {
        let mut rig = rig(setup);
        let Setup { h_m: h, level, off_m, rate_hz, .. } = setup;
        rig.drive(0.022);
        let plateau = rig.mean_force_n(0.008, 0.022) / (GC_J_PER_M2 * BLOCK_SIDE_M);
        report(&format!("h {h}, level {level}, off {off_m:+.1e}, {rate_hz} Hz"), &rig, plateau);
        let (_, work) = rig.area_and_work_ratio(GC_J_PER_M2);
        assert!((plateau - 1.0).abs() < 0.05, "F/(Gc w) = {plateau}");
        assert!((work - 1.0).abs() < 0.05, "work/(Gc A) = {work}");
        let start = rig.highest_force_n() / (GC_J_PER_M2 * BLOCK_SIDE_M);
        // Each share of the edge starts at 2 Gc; the shares at the block's sides, where it gives way
        // sideways, start first.
        assert!((1.8..2.02).contains(&start), "the first cut takes {start} Gc w, not the initiation ratio's 2");
        let (residual, residual_abs) = rig.residual_ratios();
        assert!(residual_abs < 1e-4, "energy residual {residual} ({residual_abs}) of the tool's work");
    }
}

#[test]
fn an_edge_put_down_at_the_surface_cuts_like_one_that_comes_from_above() {
    let h = 2.5e-3;
    for depth_m in [0.0, 1e-12, 0.02 * h] {
        let scene = cutting_scene(block(h, 2), 0.12, 500.0);
        let start = Vec3::new(0.0, BLOCK_HEIGHT_M - depth_m, 4e-4);
        let mut rig = Rig::new(&scene, start, attitude(0.0, 0.0, 0.0), SPEED_M_PER_S);
        rig.enter_at(start);
        rig.drive(0.02);
        let plateau = rig.mean_force_n(0.01, 0.02) / (GC_J_PER_M2 * BLOCK_SIDE_M);
        assert!((plateau - 1.0).abs() < 0.05, "{depth_m} m under the surface: F/(Gc w) = {plateau}");
    }
}

#[test]
fn an_edge_put_down_in_the_surface_and_lifted_has_cut_nothing() {
    let (h, level) = (2.5e-3, 1);
    let scene = cutting_scene(block(h, level), 0.12, 500.0);
    let above = Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4);
    let touch_n = |depth_m: Option<f64>| {
        let mut rig = Rig::new(&scene, above, attitude(0.0, 0.0, 0.0), SPEED_M_PER_S);
        if let Some(depth_m) = depth_m {
            rig.enter_at(above - Vec3::y() * (5e-4 + depth_m));
            rig.drive(2e-4);
            rig.drive_along(Vec3::y() * (3e-3 + depth_m));
            rig.drive(2.3e-3);
        }
        let before = rig.samples.len();
        rig.drive(1.5e-3);
        let (area_m2, parted) = (rig.sum(|s| s.area_m2), rig.sum(|s| f64::from(s.parted_links)));
        assert_eq!((area_m2, parted), (0.0, 0.0), "put down {depth_m:?} m under the surface");
        rig.samples[before..].iter().map(|s| s.force_n).fold(0.0, f64::max)
    };
    let first_n = touch_n(None);
    assert!(first_n > 0.1 * GC_J_PER_M2 * BLOCK_SIDE_M, "{first_n} N");
    for depth_m in [0.1 * h, 0.3 * h, 0.45 * h] {
        let again_n = touch_n(Some(depth_m));
        assert!((again_n / first_n - 1.0).abs() < 0.02, "{depth_m} m: {again_n} N, from above {first_n} N");
    }
}

#[test]
fn a_blade_put_down_in_the_tissue_stands_in_a_cut_and_cuts_on_from_there() {
    for (h, level, depth_m) in [(2.5e-3, 2, 1e-3), (2.5e-3, 2, 0.01), (2.5e-3, 0, 0.01)] {
        let scene = cutting_scene(block(h, level), 0.12, 500.0);
        let start = Vec3::new(0.0, BLOCK_HEIGHT_M - depth_m, 4e-4);
        let mut rig = Rig::new(&scene, start, attitude(0.0, 0.0, 0.0), SPEED_M_PER_S);
        rig.enter_at(start);
        rig.drive(BLOCK_HEIGHT_M - depth_m + 4e-3);
        let name = format!("h {h} m, level {level}, {depth_m} m under the surface");
        let plateau = rig.mean_force_n(0.005, 0.015) / (GC_J_PER_M2 * BLOCK_SIDE_M);
        assert!((plateau - 1.0).abs() < 0.05, "{name}: F/(Gc w) = {plateau}");
        let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
        let cut_m2 = BLOCK_SIDE_M * (BLOCK_HEIGHT_M - depth_m);
        assert!(
            (area / cut_m2 - 1.0).abs() < 0.1,
            "{name}: cut {area} of {cut_m2} m^2; the cut that it stands in is in no book"
        );
        assert!((work - 1.0).abs() < 0.05, "{name}: work/(Gc A) = {work}");
        assert_eq!(pieces(rig.body(), |_| true).len(), 2, "{name}: the cut is open to the surface");
    }
}

#[test]
fn a_blade_that_comes_back_into_its_cut_makes_no_second_one() {
    let scene = cutting_scene(block(2.5e-3, 2), 0.12, 500.0);
    let start = Vec3::new(0.0, BLOCK_HEIGHT_M + 1e-3, 4e-4);
    let parted = |comes_back: bool| {
        let mut rig = Rig::new(&scene, start, attitude(0.0, 0.0, 0.0), SPEED_M_PER_S);
        rig.drive(0.016);
        if comes_back {
            let stands = rig.position_m;
            rig.lift();
            rig.enter_at(stands);
        }
        rig.drive(0.02);
        (rig.mean_force_n(0.021, 0.027) / (GC_J_PER_M2 * BLOCK_SIDE_M), rig.sum(|s| f64::from(s.parted_links)))
    };
    let ((_, once), (plateau, twice)) = (parted(false), parted(true));
    assert!((plateau - 1.0).abs() < 0.05, "F/(Gc w) = {plateau} after it came back");
    assert!(twice <= 1.02 * once, "{once} links parted by the stroke in one, {twice} by that in two");
}

#[test]
fn a_stroke_through_the_block_leaves_two_pieces_and_no_bridge_on_any_plane() {
    let voxels = (16 * 12 * 16) as f64;
    let plane = Setup::default();
    let h = plane.h_m;
    for (name, setup) in [
        ("(0, 0, 1) between the centres", Setup { off_m: 4e-4, ..plane }),
        ("(0, 0, 1) through the centres", Setup { off_m: 0.5 * h, ..plane }),
        ("(0, 0, 1) between the voxels", Setup { off_m: h, ..plane }),
        ("(1, 0, 0)", Setup { yaw_deg: 90.0, off_m: 3e-4, ..plane }),
        ("(1, 0, 1) through the centres", Setup { yaw_deg: 45.0, ..plane }),
        ("(-1, 0, 1)", Setup { yaw_deg: -45.0, off_m: 4e-4, ..plane }),
        ("(1, 1, 1)", Setup { yaw_deg: 45.0, pitch_deg: -35.26, off_m: 3e-4, ..plane }),
        ("(0, 0, 1), edge oblique", Setup { roll_deg: 20.0, off_m: 4e-4, ..plane }),
        ("(1, 1, 1), edge oblique", Setup { yaw_deg: 45.0, roll_deg: 30.0, pitch_deg: -35.26, ..plane }),
        ("(2, 0, 3)", Setup { yaw_deg: 33.7, off_m: 1e-4, ..plane }),
    ] {
        let mut rig = rig(setup);
        let forward = rig.forward();
        let half = Vec3::new(0.5 * BLOCK_SIDE_M, 0.5 * BLOCK_HEIGHT_M, 0.5 * BLOCK_SIDE_M);
        let reach = (0..3).map(|a| half[a] * forward[a].abs()).sum::<f64>();
        rig.drive(2.0 * reach + 4e-3);
        let normal = rig.orientation * Vec3::z();
        let middle = Vec3::new(0.0, 0.5 * BLOCK_HEIGHT_M, 0.0);
        let polygon = plane_area_in_box(middle + normal * setup.off_m, normal, middle - half, middle + half);
        let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
        let sizes = pieces(rig.body(), |_| true);
        report(&format!("{name}: pieces {sizes:?} of {voxels}, A / polygon {:.3}", area / polygon), &rig, 0.0);
        assert_eq!(sizes.len(), 2, "{name}: pieces of {sizes:?} voxels");
        assert_eq!(rig.body().part_count(), 2);
        assert!((area / polygon - 1.0).abs() < 0.08, "{name}: swept {area}, the plane's polygon is {polygon}");
        assert!((work - 1.0).abs() < 0.05, "{name}: work/(Gc A) = {work}");
    }
}
