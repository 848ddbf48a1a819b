//! A tick of the servo allocates nothing, whatever it is given.
#![allow(unsafe_code, reason = "a global allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use kerf_station::config::DeviceConfig;
use kerf_station::device::simulated::Simulated;
use kerf_station::device::{Device, DeviceState, Servo};
use kerf_station::servo::model::Update;
use kerf_station::servo::runner::{Motion, Runner, Slots, settings};
use nalgebra::Vector3;

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
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_tick_allocates_nothing() {
    let (mut updates, contacts) = triple_buffer::triple_buffer(&Update::default());
    let (motions, _motion) = triple_buffer::triple_buffer(&Motion::default());
    // Too small on purpose: a monitor that does not keep up costs nothing either.
    let (samples, _sample) = rtrb::RingBuffer::new(16);
    let slots = Slots { updates: contacts, motions, samples, is_leaving: std::sync::Arc::default() };
    let device = Simulated::new(&kerf_station::config::SimulatedConfig::default());
    let config = DeviceConfig::default();
    let mut runner = Runner::new(settings(device.info(), &config), &config, [0].into(), slots);
    let states =
        [0.0, -0.004, f64::NAN].map(|y| DeviceState { position_m: Vector3::y() * y, ..DeviceState::default() });
    let before = ALLOCATIONS.get();
    for tick in 1..1000_u64 {
        updates.write(Update { number: tick, arrived_ns: tick * 1_000_000, max_age_s: 0.1, ..Update::default() });
        let force_n = runner.tick(tick * 1_000_000, &states[tick as usize / 10 % 3]);
        assert!(force_n.norm().is_finite());
    }
    assert_eq!(ALLOCATIONS.get() - before, 0);
}
