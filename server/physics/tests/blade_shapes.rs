//! The cut has the shape of the blade's edge, whatever that is.

use super::support::cutting::*;
use super::support::swept::{Swept, crossings};
use kerf_physics::scene::{BladeDesc, EdgeDesc, ToolDesc};
use kerf_physics::tool::blade::Blade;
use kerf_physics::{Quat, Vec3};

const H_M: f64 = 2.5e-3;
/// Voxels of the block.
const VOXELS: usize = 16 * 12 * 16;
const WIDTH_M: f64 = 0.08;

/// Points of a fold line over [`WIDTH_M`], tool frame: teeth of 16 mm, `across_m` to either side, and each
/// second one `ahead_m` ahead.
fn fold_line(across_m: f64, ahead_m: f64) -> EdgeDesc {
    let point = |i: i32| {
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        [f64::from(i) * 8e-3, -0.5 * (1.0 + side) * ahead_m, side * across_m]
    };
    EdgeDesc::Polyline { points_m: (-5..=5).map(point).collect() }
}

fn blade(edge: EdgeDesc) -> BladeDesc {
    BladeDesc { edge, ..BladeDesc::straight(WIDTH_M, 0.06) }
}

/// A block and a blade of this edge, clear of its top.
fn rig(h: f64, edge: EdgeDesc, orientation: Quat, off_m: f64) -> Rig {
    let mut scene = cutting_scene(block(h, 2), WIDTH_M, 1000.0);
    scene.desc.tools = vec![ToolDesc::blade("blade", blade(edge))];
    assert_eq!(scene.problems(), []);
    let [forward, normal] = [-Vec3::y(), Vec3::z()].map(|axis| orientation * axis);
    let middle = Vec3::new(0.0, 0.5 * BLOCK_HEIGHT_M, 0.0) + normal * off_m;
    Rig::new(&scene, middle - forward * reach_m(&forward), orientation, 0.1)
}

/// From the block's middle to beyond its sides along `forward`, m: wide enough for every edge here.
fn reach_m(forward: &Vec3) -> f64 {
    let half = Vec3::new(0.5 * BLOCK_SIDE_M, 0.5 * BLOCK_HEIGHT_M, 0.5 * BLOCK_SIDE_M);
    half.component_mul(&forward.abs()).sum() + 2e-3
}

#[test]
fn the_cut_follows_the_edge_within_half_a_voxel_and_leaves_two_pieces() {
    let level = Quat::identity();
    let sine = || EdgeDesc::Sine { amplitude_m: 4e-3, wavelength_m: 20e-3 };
    for (name, edge, orientation, off_m) in [
        ("straight", EdgeDesc::Straight, level, 4e-4),
        ("straight, tilted", EdgeDesc::Straight, attitude(25.0, 15.0, -20.0), 4e-4),
        ("fold line", fold_line(4e-3, 0.0), level, 4e-4),
        ("fold line, tilted", fold_line(4e-3, 0.0), attitude(20.0, 0.0, -15.0), 4e-4),
        ("fold line, each second tooth ahead", fold_line(3e-3, 2e-3), level, 4e-4),
        ("fold line, tilted, each second tooth ahead", fold_line(3e-3, 3e-3), attitude(15.0, -10.0, 10.0), 1e-4),
        ("sine", sine(), level, 4e-4),
        ("sine, tilted", sine(), attitude(-30.0, 10.0, 10.0), 1e-4),
        ("arc", EdgeDesc::Arc { sagitta_m: 16e-3 }, level, 4e-4),
        ("hollow arc", EdgeDesc::Arc { sagitta_m: -16e-3 }, level, 4e-4),
    ] {
        let mut rig = rig(H_M, edge.clone(), orientation, off_m);
        let start = rig.position_m;
        let (forward, edge) = (rig.forward(), Blade::new(&blade(edge)).unwrap().edge);
        let ends = edge.points_m().iter().map(|p| p.y).fold([0.0f64; 2], |[low, high], y| [low.min(y), high.max(y)]);
        rig.position_m += forward * ends[0];
        rig.drive(2.0 * reach_m(&forward) + ends[1] - ends[0]);
        let grid = &rig.body().state.grid;
        let swept = Swept(edge.points_m().to_vec());
        let local = |at: &Vec3| orientation.inverse() * (at - start);
        let found: Vec<Vec3> = crossings(grid).iter().map(local).collect();
        let off = found.iter().map(|at| swept.distance_m(at).abs()).fold(0.0, f64::max);
        // The other way: from the swept surface inside the block to the nearest crossing, which on a lattice
        // may be the half diagonal of a face away.
        let half = Vec3::new(0.5 * BLOCK_SIDE_M, 0.5 * BLOCK_HEIGHT_M, 0.5 * BLOCK_SIDE_M);
        let surface = swept.surface(0.25 * H_M, |at| {
            let offset = start + orientation * at - Vec3::new(0.0, 0.5 * BLOCK_HEIGHT_M, 0.0);
            (half - offset.abs()).min()
        });
        let nearest = |at: Vec3| found.iter().map(|f| (f - at).norm()).fold(f64::INFINITY, f64::min);
        let deep = surface.iter().filter(|(_, _, depth_m)| *depth_m > 0.5 * H_M);
        let missed = deep.map(|(at, _, _)| nearest(*at)).fold(0.0, f64::max);
        let exact: f64 = surface.iter().map(|(_, area_m2, _)| area_m2).sum();
        // And voxels half a voxel and more beside it are in the piece of their side.
        let beside = |side: f64| pieces(rig.body(), |at| side * swept.distance_m(&local(&at)) > 0.5 * H_M);
        let sizes = pieces(rig.body(), |_| true);
        let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
        println!(
            "{name}: crossings off by {:.2} h, surface missed by {:.2} h, pieces {sizes:?}, A / surface {:.3}, \
             work/(Gc A) {work:.3}",
            off / H_M,
            missed / H_M,
            area / exact
        );
        assert!(off <= 0.5 * H_M, "{name}: a crossing {off} m off the swept surface");
        assert!(missed <= (0.5f64.sqrt() + 0.5) * H_M, "{name}: no crossing within {missed} m of the swept surface");
        assert_eq!(sizes.len(), 2, "{name}: pieces of {sizes:?} voxels");
        assert_eq!(sizes.iter().sum::<usize>(), VOXELS);
        let mut sides = [1.0, -1.0].map(|side| beside(side).iter().sum::<usize>());
        sides.sort_unstable();
        assert!(sides[0] <= sizes[0] && sides[1] <= sizes[1], "{name}: {sides:?} voxels beside, pieces {sizes:?}");
        assert!((area / exact - 1.0).abs() < 0.05, "{name}: swept {area}, the surface has {exact}");
        assert!((work - 1.0).abs() < 0.05, "{name}: work/(Gc A) = {work}");
    }
}

#[test]
fn the_bottom_of_an_unfinished_cut_is_the_edge_less_the_dent() {
    // Belly and teeth: how deep the cut goes under each column of voxels, against the edge above it.
    for (name, edge) in [("arc", EdgeDesc::Arc { sagitta_m: 16e-3 }), ("teeth ahead", fold_line(0.0, 6e-3))] {
        let mut rig = rig(H_M, edge.clone(), Quat::identity(), 4e-4);
        let edge_m = Blade::new(&blade(edge)).unwrap().edge.points_m().to_vec();
        // From where its foremost point is clear of the block.
        rig.position_m.y -= edge_m.iter().map(|p| p.y).fold(0.0, f64::min);
        rig.drive(0.024);
        let mut checked = 0;
        let found = crossings(&rig.body().state.grid);
        for column in 0..16 {
            let x = (f64::from(column) - 7.5) * H_M;
            let below = found.iter().filter(|at| (at.x - x).abs() < 1e-9).map(|at| at.y).fold(f64::INFINITY, f64::min);
            let at = edge_m.partition_point(|p| p.x <= x);
            let (from, to) = (edge_m[at - 1], edge_m[at]);
            let tip = rig.position_m.y + from.y + (to.y - from.y) * (x - from.x) / (to.x - from.x);
            if tip < BLOCK_HEIGHT_M - 2.0 * H_M {
                // A line load of Gc dents by some 4 Gc/E; the block's sides yield to the next column.
                let (above, dent) = (below - tip, 4.0 * GC_J_PER_M2 / YOUNG_PA);
                assert!((-0.5 * H_M..H_M + dent).contains(&above), "{name}, x {x}: cut to {below}, edge at {tip}");
                checked += 1;
            }
        }
        assert!(checked >= 8, "{name}: the edge is deep in {checked} columns only");
        assert_eq!(rig.body().part_count(), 1);
    }
}

#[test]
fn a_wave_narrower_than_the_block_cuts_a_slot_of_its_own_length() {
    let narrow = BladeDesc {
        edge: EdgeDesc::Sine { amplitude_m: 3e-3, wavelength_m: 12e-3 },
        ..BladeDesc::straight(0.018, 0.06)
    };
    let length_m = Blade::new(&narrow).unwrap().edge.length_m();
    let mut scene = cutting_scene(block(H_M, 2), 0.018, 1000.0);
    scene.desc.tools = vec![ToolDesc::blade("blade", narrow)];
    let mut rig = Rig::new(&scene, Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4), Quat::identity(), 0.1);
    rig.drive(0.02);
    let force = rig.mean_force_n(0.008, 0.02) / (GC_J_PER_M2 * length_m);
    let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
    println!("slot: F/(Gc L) {force:.3}, work/(Gc A) {work:.3}, A {area:.3e} m^2");
    assert!((force - 1.0).abs() < 0.05, "F/(Gc L) = {force}");
    assert!((work - 1.0).abs() < 0.05, "work/(Gc A) = {work}");
    assert_eq!(rig.body().part_count(), 1);
}

#[test]
fn a_wave_takes_gc_per_length_of_its_edge_on_every_mesh() {
    for (name, edge) in
        [("sine", EdgeDesc::Sine { amplitude_m: 4e-3, wavelength_m: 20e-3 }), ("fold line", fold_line(4e-3, 0.0))]
    {
        for h in [2.5e-3, 1.25e-3] {
            let swept = Swept(Blade::new(&blade(edge.clone())).unwrap().edge.points_m().to_vec());
            let length_m = swept.length_m(|x| x.abs() < 0.5 * BLOCK_SIDE_M);
            let mut rig = rig(h, edge.clone(), Quat::identity(), 4e-4);
            rig.drive(0.022);
            let force = rig.mean_force_n(0.01, 0.022) / (GC_J_PER_M2 * length_m);
            let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
            let (residual, residual_abs) = rig.residual_ratios();
            println!(
                "{name}, h {h}: edge in the block {:.2} of its width, F/(Gc L) {force:.3}, work/(Gc A) {work:.3}, \
                 A {area:.3e}, residual {residual:.1e} ({residual_abs:.1e})",
                length_m / BLOCK_SIDE_M
            );
            assert!((force - 1.0).abs() < 0.05, "{name}, h {h}: F/(Gc L) = {force}");
            assert!((work - 1.0).abs() < 0.05, "{name}, h {h}: work/(Gc A) = {work}");
            assert!(residual_abs < 1e-3, "{name}: energy residual {residual} ({residual_abs})");
        }
    }
}
