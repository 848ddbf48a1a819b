//! A state is written to a file, and another world, in another process too, goes on from it to the same bits.

use super::support::busy::{Busy, KINDS, busy_scene};
use super::support::world_of;
use kerf_physics::world::LoadError;
use kerf_physics::{StepOutput, StepProfile, Workers, World};
use std::process::Command;

/// Steps after which a state is written: in the midst of cuts.
const BEFORE: u32 = 120;
/// Where a process that is to go on from a file finds it, and what kind of scene it is of.
const FILE: &str = "KERF_TEST_SNAPSHOT";
const KIND: &str = "KERF_TEST_KIND";

fn loaded(kind: usize, file: &[u8]) -> Busy {
    let mut other = Busy::new(kind);
    other.world.load(file).expect("a file of the same scene");
    other
}

/// What the last step reported, but for the time that it took.
fn reported(busy: &Busy) -> StepOutput {
    StepOutput { profile: StepProfile::default(), ..busy.world.output().clone() }
}

#[test]
fn a_loaded_state_goes_on_to_the_same_bits_on_two_threads() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    for kind in 0..KINDS {
        let mut busy = Busy::new(kind);
        let before = busy.run(BEFORE);
        let mut other = loaded(kind, &busy.world.save());
        assert_eq!((other.world.state_hash(), reported(&other)), (busy.world.state_hash(), reported(&busy)));
        let mut parted = 0;
        for round in 0..5 {
            parted += busy.run(50);
            other.run_with(&Workers::of(&pool), 50);
            let difference = busy.world.snapshot().difference(&other.world.snapshot());
            assert_eq!(difference, None, "kind {kind}, {} steps on", 50 * (round + 1));
            assert_eq!(reported(&other), reported(&busy));
            assert_eq!(other.world.state_hash(), busy.world.state_hash());
        }
        assert!(before > 20 && parted > 20, "kind {kind}: {before} and {parted} links parted");
        assert_eq!(other.world.surface_hash(), busy.world.surface_hash());
    }
}

#[test]
fn a_state_that_is_written_is_as_it_was_and_so_is_one_that_is_written_again() {
    for kind in 0..KINDS {
        let mut busy = Busy::new(kind);
        for _ in 0..6 {
            busy.run(40);
            let hash = busy.world.state_hash();
            let file = busy.world.save();
            assert_eq!(busy.world.state_hash(), hash);
            assert!(loaded(kind, &file).world.save() == file, "kind {kind}");
        }
    }
}

/// Prints the hash a thousand steps after the file that the environment names.
#[test]
#[ignore = "slow: a part of the next one, which runs it in a process of its own"]
fn goes_on_from_a_file() {
    let [Ok(file), Ok(kind)] = [FILE, KIND].map(std::env::var) else { return };
    let mut busy = loaded(kind.parse().expect("a number"), &std::fs::read(file).expect("a file"));
    busy.run(1000);
    println!("hash {:016x}", busy.world.state_hash());
}

#[test]
fn a_fresh_process_goes_on_to_the_same_bits_for_a_thousand_steps() {
    let kind = 1;
    let mut busy = Busy::new(kind);
    busy.run(BEFORE);
    let path = std::env::temp_dir().join(format!("kerf-snapshot-{}", std::process::id()));
    std::fs::write(&path, busy.world.save()).expect("room for a file");
    let mut command = Command::new(std::env::current_exe().expect("this test"));
    command.args(["--exact", "tests::snapshot_file::goes_on_from_a_file", "--ignored", "--nocapture"]);
    let output = command.env(FILE, &path).env(KIND, kind.to_string()).output().expect("a process");
    std::fs::remove_file(&path).expect("the file");
    busy.run(1000);
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(told.contains(&format!("hash {:016x}", busy.world.state_hash())), "{told}");
}

/// What is said of a file.
fn refused(world: &mut World, file: &[u8]) -> String {
    let hash = world.state_hash();
    let error = world.load(file).expect_err("it is refused");
    assert_eq!(world.state_hash(), hash, "{error}: the world is as it was");
    error.to_string()
}

#[test]
fn a_file_of_another_format_or_scene_is_refused_with_the_reason() {
    let mut busy = Busy::new(0);
    busy.run(5);
    let file = busy.world.save();
    let mut other_format = file.clone();
    other_format[8] += 1;
    assert!(refused(&mut busy.world, &other_format).starts_with("format: it is "));
    assert_eq!(refused(&mut busy.world, b"glTF"), LoadError::NoSnapshot.to_string());
    let other = |change: &dyn Fn(&mut kerf_physics::SceneDesc)| {
        let mut scene = busy_scene(0);
        change(&mut scene.desc);
        refused(&mut world_of(&scene), &file)
    };
    assert_eq!(other(&|d| d.name = "other".into()), "scene.name: the file is of `test`, and this is `other`");
    assert_eq!(other(&|d| d.rate_hz = 250.0), "scene.rate_hz: the file is of 500 Hz, and this is 250 Hz");
    let stiffer = other(&|d| d.objects[0].material.young_modulus_pa *= 2.0);
    assert!(stiffer.starts_with("scene.objects[0].material.young_modulus_pa: the scene "), "{stiffer}");
    assert!(other(&|d| d.gravity_m_per_s2[1] -= 1.0).starts_with("scene.gravity_m_per_s2[1]: "));
    assert!(other(&|d| drop(d.tools.pop())).starts_with("scene.tools: "));
}

#[test]
fn a_file_that_is_cut_off_or_has_a_bit_flipped_is_refused() {
    let mut busy = Busy::new(0);
    busy.run(30);
    let file = busy.world.save();
    for end in (0..file.len()).step_by(file.len() / 97) {
        refused(&mut busy.world, &file[..end]);
    }
    for bit in (0..8 * file.len()).step_by(8 * file.len() / 101) {
        let mut flipped = file.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        refused(&mut busy.world, &flipped);
    }
    busy.world.load(&file).expect("what was written");
}
