//! A step in which no link parts allocates nothing.
#![allow(unsafe_code, reason = "a global allocator is an unsafe trait")]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use kerf_physics::World;
use kerf_physics::scene::ShapeDesc;
use kerf_physics::{NoClock, StepInputs, Workers};
use support::press::{LAWS, cutting_scene, press};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting what the calling thread asks for.
struct Counting;

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
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

#[test]
fn a_step_without_fracture_allocates_nothing() {
    for (law, change) in LAWS.into_iter().enumerate() {
        let mut scene = cutting_scene();
        change(&mut scene.desc.objects[0].material);
        let mut world = World::new(&scene).expect("a valid scene");
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
fn bodies_that_press_and_rub_on_each_other_allocate_nothing() {
    let mut lower = support::object([-0.02, 0.0, -0.02], [0.02, 0.02, 0.02], 0.0025, 2);
    lower.name = "lower".into();
    lower.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.003, 1.0] }];
    let mut upper = support::object([-0.015, 0.0201, -0.015], [0.025, 0.04, 0.025], 0.0025, 2);
    for object in [&mut lower, &mut upper] {
        object.material.rayleigh_beta_s = 1e-3;
        object.material.friction_coefficient = 0.3;
    }
    let mut scene = support::scene(vec![lower, upper]);
    scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    let mut world = World::new(&scene).expect("a valid scene");
    world.body_mut(1).velocity_m_per_s.iter_mut().for_each(|v| *v = [0.05, -0.1, 0.0]);
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
