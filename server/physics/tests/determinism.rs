//! The same inputs give the same bits, whatever the number of threads.

mod support;

use kerf_physics::{Workers, World};
use support::press::{cutting_scene, press_with};

/// State hash every ten steps of a stroke deep into the block.
fn hashes(workers: &Workers<'_>, level: u8) -> Vec<u64> {
    let mut scene = cutting_scene();
    scene.desc.objects[0].level = level;
    let mut world = World::new(&scene).expect("a valid scene");
    let mut parted = 0;
    let mut hashes = Vec::new();
    for i in 0..60 {
        parted += press_with(&mut world, workers, 0.041 - 4e-4 * f64::from(i)).fracture.parted_links;
        if i % 10 == 9 {
            hashes.push(world.state_hash());
        }
    }
    assert!(parted > 30, "{parted} links parted");
    hashes
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    // At level 0 the block has 16,384 elements: enough work to be shared out.
    for level in [2, 0] {
        assert_eq!(hashes(&Workers::serial(), level), hashes(&Workers::of(&pool), level), "level {level}");
    }
}
