//! A step whose work is bounded: what it may leave undone, and what that does to forces.

use super::support::press::{cutting_scene, pose_at};
use super::support::world_of;
use kerf_physics::scene::{GovernorDesc, Scene};
use kerf_physics::step_io::ContactModel;
use kerf_physics::{NoClock, StepInputs, StepOutput, ToolInput, Workers, World};

/// Steps of a millisecond at 0.2 m/s: the blade touches, the block gives, a cut goes deep into it.
const STEPS: u32 = 120;

/// A world after the stroke, and what each step said.
fn stroke(scene: &Scene, work_units: Option<u64>) -> (World, Vec<StepOutput>) {
    let mut world = world_of(scene);
    let mut step = |step: u32| {
        let tools = [ToolInput { tool: 0, motion: pose_at(0.041 - 2e-4 * f64::from(step)) }];
        let inputs = StepInputs { work_units, ..StepInputs::of(&tools) };
        world.step(&Workers::serial(), &NoClock, &inputs).clone()
    };
    let outputs = (0..STEPS).map(&mut step).collect();
    (world, outputs)
}

fn work_units(outputs: &[StepOutput]) -> Vec<u64> {
    let mut units: Vec<u64> = outputs.iter().map(|output| output.solve.work_units).collect();
    units.sort_unstable();
    units
}

#[test]
fn a_budget_that_is_never_used_up_changes_no_bit() {
    let scene = cutting_scene();
    let (world, outputs) = stroke(&scene, None);
    let parted: u32 = outputs.iter().map(|output| output.fracture.parted_links).sum();
    assert!(parted > 30, "it cuts");
    assert!(outputs.iter().all(|output| !output.solve.is_cut_short));
    assert_eq!(stroke(&scene, Some(u64::MAX)).0.state_hash(), world.state_hash());
    assert_ne!(stroke(&scene, Some(0)).0.state_hash(), world.state_hash());
}

#[test]
fn a_budget_takes_the_tail_off_the_work_of_a_stroke_and_leaves_its_forces() {
    let scene = cutting_scene();
    let (_, whole) = stroke(&scene, None);
    let units = work_units(&whole);
    let median = units[units.len() / 2];
    let (_, bounded) = stroke(&scene, Some(median));
    let most_n = whole.iter().map(|output| output.tools[0].wrench.force_n.norm()).fold(0.0, f64::max);
    let mut lasts = 0;
    for (step, (bounded, whole)) in bounded.iter().zip(&whole).enumerate() {
        let error_n = (bounded.tools[0].wrench.force_n - whole.tools[0].wrench.force_n).norm();
        lasts = if error_n > 0.05 * most_n { lasts + 1 } else { 0 };
        assert!(lasts <= 10, "step {step}: {error_n} N off {most_n} N");
        assert!(bounded.solve.relative_residual <= 0.03, "step {step}: {}", bounded.solve.relative_residual);
    }
    assert!(bounded.iter().any(|output| output.solve.is_cut_short), "there was something to give up");
    let work_j = |outputs: &[StepOutput]| outputs.iter().map(|output| output.energy.tool_work_j).sum::<f64>();
    let off = work_j(&bounded) / work_j(&whole) - 1.0;
    assert!(off.abs() < 0.01, "work is {off} off");
    let most = |outputs: &[StepOutput]| outputs.iter().map(|output| output.solve.iterations).max().expect("steps");
    assert!(10 * most(&bounded) <= 7 * most(&whole), "{} iterations for {}", most(&bounded), most(&whole));
}

#[test]
fn contact_models_are_made_piece_by_piece_and_come_to_the_same_stiffness() {
    // The blade rests on the block. Work is used up from the start, yet no solve may end early.
    let resting = |work_units| {
        let mut scene = cutting_scene();
        let max_relative_tolerance = scene.desc.relative_tolerance();
        scene.desc.governor = Some(GovernorDesc { max_relative_tolerance });
        let mut world = world_of(&scene);
        let tools = [ToolInput { tool: 0, motion: pose_at(0.0395) }];
        let inputs = StepInputs { tools: &tools, work_units, models: &[0] };
        let step = |_| world.step(&Workers::serial(), &NoClock, &inputs).tools[0].contact;
        let contacts: Vec<_> = (0..200).map(step).collect();
        (contacts, world.state_hash())
    };
    let [(whole, hash), (pieces, same)] = [None, Some(0)].map(resting);
    assert_eq!(hash, same, "what the step does is the same");
    let first = |contacts: &[Option<_>]| contacts.iter().position(Option::is_some);
    assert_eq!((first(&whole), first(&pieces)), (Some(0), Some(5)), "six fields, one a step");
    let last = |contacts: &[Option<ContactModel>]| contacts.last().copied().flatten().expect("it touches").stiffness;
    let [whole, pieces] = [last(&whole), last(&pieces)];
    for twist in 0..6 {
        let [a, b] = [whole, pieces].map(|stiffness| stiffness[twist][twist]);
        assert!((a - b).abs() <= 0.02 * a.abs(), "twist {twist}: {b} for {a}");
    }
}
