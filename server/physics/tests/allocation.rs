//! A step in which no link parts allocates nothing.
#![allow(unsafe_code, reason = "a global allocator is an unsafe trait")]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use kerf_physics::World;
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
fn nor_does_one_that_adapts_the_surface() {
    let mut world = World::new(&cutting_scene()).expect("a valid scene");
    let _ = world.keyframe();
    // Warm-up: the adaptation comes into being when the blade first touches.
    for height_m in [0.05, 0.0395] {
        press(&mut world, height_m);
    }
    let (pressing, none) = stroke(&mut world, 0.0394, 0.02, 20);
    assert!(!world.adapted_vertices(0).is_empty());
    assert_eq!((pressing, none), (0, 0), "pressing");
}
