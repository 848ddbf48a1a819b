//! A step in which no link parts allocates nothing, and what a scene holds for each of its voxels.
#![allow(unsafe_code, reason = "a global allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use super::support::press::{LAWS, cutting_scene, press};
use super::support::world_of;
use kerf_physics::scene::{BladeDesc, CapsuleDesc, EdgeDesc, GrasperDesc, RateDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
    static HELD_BYTES: Cell<i64> = const { Cell::new(0) };
}

/// The system's allocator, counting what the calling thread asks for.
struct Counting;

/// Of the calling thread: so many more allocations, and so many more bytes held.
fn count(allocations: u64, bytes: i64) {
    ALLOCATIONS.with(|count| count.set(count.get() + allocations));
    HELD_BYTES.with(|held| held.set(held.get() + bytes));
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(1, layout.size() as i64);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(0, -(layout.size() as i64));
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(1, size as i64 - layout.size() as i64);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Presses for `steps` steps; allocations of the steps in which nothing parted, and how many parted.
fn stroke(world: &mut World, from_m: f64, speed_m_per_s: f64, steps: usize) -> (u64, usize) {
    let (mut allocations, mut fractures) = (0, 0);
    for i in 0..steps {
        let before = ALLOCATIONS.get();
        let parted = press(world, from_m - 1e-3 * speed_m_per_s * i as f64).fracture.parted_links;
        if parted == 0 {
            allocations += ALLOCATIONS.get() - before;
        } else {
            fractures += 1;
        }
    }
    (allocations, fractures)
}

/// What a voxel may take: some more than was measured.
const BYTES_PER_VOXEL: f64 = 160.0;

#[test]
fn blades_of_every_kind_allocate_nothing_either() {
    let sine = EdgeDesc::Sine { amplitude_m: 4e-3, wavelength_m: 2e-2 };
    let rubbing = BladeDesc {
        edge: sine,
        thickness_m: 1e-3,
        wedge_angle_rad: Some(0.2),
        flank_friction: Some(0.3),
        ..BladeDesc::straight(0.06, 0.05)
    };
    let mut scene = cutting_scene();
    scene.desc.tools = vec![ToolDesc::blade("blade", rubbing)];
    scene.desc.objects[0].material.rate = Some(RateDesc { reference_speed_m_per_s: 1e-2, exponent: 0.3 });
    let mut world = world_of(&scene);
    press(&mut world, 0.05);
    let (pressing, none) = stroke(&mut world, 0.041, 0.05, 20);
    assert_eq!((pressing, none), (0, 0), "pressing");
    let (cutting, fractures) = stroke(&mut world, 0.040, 0.3, 80);
    assert!(fractures > 3, "{fractures} steps with fracture");
    assert_eq!(cutting, 0, "cutting");
}

#[test]
fn a_step_without_fracture_allocates_nothing() {
    for (law, change) in LAWS.into_iter().enumerate() {
        let mut scene = cutting_scene();
        change(&mut scene.desc.objects[0].material);
        let mut world = world_of(&scene);
        // Warm-up: the vectors of a solve come into being in the first step.
        press(&mut world, 0.05);
        let (pressing, none) = stroke(&mut world, 0.041, 0.05, 20);
        assert_eq!((pressing, none), (0, 0), "pressing, law {law}");
        let (cutting, fractures) = stroke(&mut world, 0.040, 0.3, 80);
        assert!(fractures > 3, "{fractures} steps with fracture");
        assert_eq!(cutting, 0, "cutting, law {law}");
    }
}

#[test]
fn a_world_that_went_back_to_a_snapshot_allocates_nothing_either() {
    let mut world = world_of(&cutting_scene());
    press(&mut world, 0.05);
    let snapshot = world.snapshot();
    stroke(&mut world, 0.040, 0.3, 40);
    world.restore(&snapshot);
    press(&mut world, 0.05);
    assert_eq!(stroke(&mut world, 0.0402, 0.05, 20), (0, 0), "contacts that the snapshot has not");
}

#[test]
fn neither_holding_nor_pressing_allocates() {
    let handle = Some(CapsuleDesc { radius_m: 0.01, length_m: 0.01 });
    let upside_down = Quat::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    let tools = [
        (ToolDesc::blade("blade", BladeDesc::straight(0.06, 0.05)), 0.0405, 5e-5),
        (ToolDesc::blade("handle", BladeDesc { handle, ..BladeDesc::straight(0.06, 0.005) }), 0.0755, 1e-4),
        (ToolDesc::grasper("grasper", GrasperDesc::new(0.008)), 0.045, 1e-4),
        (ToolDesc::probe("probe", CapsuleDesc { radius_m: 0.01, length_m: 0.01 }), 0.045, 1e-4),
    ];
    for (tool, from_m, step_m) in tools {
        let mut scene = cutting_scene();
        scene.desc.tools = vec![tool.clone()];
        let mut world = world_of(&scene);
        // A world that went back has room for what its snapshot does not hold.
        let rest = world.snapshot();
        world.restore(&rest);
        let mut allocations = 0;
        for i in 0..60 {
            let position_m = Vec3::new(0.0, from_m - step_m * f64::from(i), 0.0);
            // What is behind the spine goes in first.
            let orientation = if tool.name == "handle" { upside_down } else { Quat::identity() };
            let pose = Pose { position_m, orientation };
            let opening = if (20..40).contains(&i) { 0.0 } else { 1.0 };
            let inputs = [ToolInput { tool: 0, motion: ToolMotion::MoveTo { pose, opening } }];
            let before = ALLOCATIONS.get();
            // With a model of the contact, too.
            world.step(&Workers::serial(), &NoClock, &StepInputs { models: &[0], ..StepInputs::of(&inputs) });
            // The vectors of a solve come into being in the first step.
            allocations += if i > 0 { ALLOCATIONS.get() - before } else { 0 };
            if i == 30 {
                assert!(world.output().tools[0].wrench.force_n.norm() > 0.0, "{}", tool.name);
            }
        }
        assert_eq!(allocations, 0, "{}", tool.name);
    }
}

#[test]
fn nor_does_adapting_the_surface_to_one() {
    let mut world = world_of(&cutting_scene());
    let _ = world.keyframe();
    // Warm-up: the adaptation comes into being when the blade first touches.
    for height_m in [0.05, 0.0395] {
        press(&mut world, height_m);
        world.adapt_surface(&NoClock);
    }
    for i in 0..20 {
        let before = ALLOCATIONS.get();
        let parted = press(&mut world, 0.0394 - 2e-5 * f64::from(i)).fracture.parted_links;
        world.adapt_surface(&NoClock);
        assert_eq!((ALLOCATIONS.get() - before, parted), (0, 0), "step {i}");
        assert!(!world.adapted_vertices(0).is_empty());
    }
}

#[test]
fn bodies_that_press_and_rub_on_each_other_allocate_nothing() {
    let mut lower = super::support::object([-0.02, 0.0, -0.02], [0.02, 0.02, 0.02], 0.0025, 2);
    lower.name = "lower".into();
    lower.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.003, 1.0] }];
    let mut upper = super::support::object([-0.015, 0.0201, -0.015], [0.025, 0.04, 0.025], 0.0025, 2);
    for object in [&mut lower, &mut upper] {
        object.material.rayleigh_beta_s = 1e-3;
        object.material.friction_coefficient = 0.3;
    }
    let mut scene = super::support::scene(vec![lower, upper]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    let mut world = world_of(&scene);
    world.body_mut(1).state.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.05, -0.1, 0.0]);
    let step = |world: &mut World| {
        let before = ALLOCATIONS.get();
        world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        ALLOCATIONS.get() - before
    };
    step(&mut world);
    let (mut allocations, mut pressed) = (0, 0);
    for _ in 0..40 {
        allocations += step(&mut world);
        pressed += u32::from(world.tissue_springs().iter().any(|s| s.friction.is_some()));
    }
    assert!(pressed > 20, "in contact for {pressed} steps");
    assert_eq!(allocations, 0);
}

#[test]
fn a_voxel_of_a_large_body_takes_few_bytes() {
    let mut scene = cutting_scene();
    let object = &mut scene.desc.objects[0];
    // 64 voxels to an element, fixed below, with as much surface as an organ of 250,000 voxels.
    object.shape = ShapeDesc::Ellipsoid { center_m: [0.0, 0.03, 0.0], semi_axes_m: [0.05, 0.03, 0.04] };
    (object.voxel_size_m, object.level) = (Some(1e-3), 2);
    object.material.fracture_energy_j_per_m2 = Some(100.0);
    let before = HELD_BYTES.get();
    let mut world = world_of(&scene);
    let (held, voxels) = (HELD_BYTES.get() - before, world.counts().voxels);
    let per_voxel = held as f64 / voxels as f64;
    println!("{voxels} voxels of {per_voxel:.0} bytes");
    // 20 of them are the voxel's place, material and distance from the surface, 4 its element; the matrices of an element
    // at the surface are 20 kB, those of all others are shared.
    assert!(per_voxel < BYTES_PER_VOXEL, "{per_voxel} bytes");
}
