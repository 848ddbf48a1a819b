//! A guard a test: each fails when its guard is taken out.

use std::collections::VecDeque;

use nalgebra::Matrix3;

use super::super::model::tests::{at, floor};
use super::super::model::{Along, Give, LocalModel, Update};
use super::*;

const DT_S: f64 = 1e-3;
const MAX_AGE_S: f64 = 0.1;

/// Nothing but what a test is about is in the way.
fn settings() -> Settings {
    Settings {
        peak_force_n: 100.0,
        slew_n_per_s: 1e6,
        ramp_s: 1e-3,
        fade_s: 1e-3,
        coupling: CouplingLimits {
            min_stiffness_n_per_m: 20.0,
            max_stiffness_n_per_m: 500.0,
            max_damping_n_s_per_m: 5.0,
            mass_kg: 0.1,
        },
        passivity: None,
        fault: FaultLimits { max_gap_s: 0.02, max_speed_m_per_s: 5.0, hold_s: 0.25 },
    }
}

fn update(number: u64, model: Option<LocalModel>) -> Update {
    Update { number, model, blend_s: 8e-3, round_trip_s: 2e-3, max_age_s: MAX_AGE_S, ..Update::default() }
}

fn hand(y_m: f64) -> Hand {
    Hand { pose: at(0.0, y_m, 0.0), velocity_m_per_s: Vector3::zeros() }
}

/// Ticks with the hand at rest and a model that is always new.
fn hold_still(core: &mut Core, hand: &Hand, update: &Update, ticks: usize) -> Vec<Rendered> {
    (0..ticks).map(|_| core.tick(DT_S, hand, None, Some(Newest { update, age_s: 0.0, pose_age_s: 0.0 }))).collect()
}

/// A core in steady contact at 2 mm: the floor pushes with 1.5 N.
fn in_contact(settings: Settings) -> Core {
    let mut core = Core::new(settings);
    let force_n = hold_still(&mut core, &hand(-4e-3), &update(1, Some(floor())), 8000).last().unwrap().force_n;
    assert!((force_n.y - 1.5).abs() < 1e-3 || settings.peak_force_n < 1.5, "{force_n}");
    core
}

fn largest_jump_n(forces: &[Rendered]) -> f64 {
    forces.windows(2).map(|pair| (pair[1].force_n - pair[0].force_n).norm()).fold(0.0, f64::max)
}

#[test]
fn the_force_never_exceeds_the_devices_and_keeps_its_direction() {
    let mut core = Core::new(Settings { peak_force_n: 1.0, ..settings() });
    let slanted = Hand { pose: at(-4e-3, -4e-3, 0.0), velocity_m_per_s: Vector3::zeros() };
    let model = LocalModel {
        force_n: Vector3::new(1.0, 1.0, 0.0),
        stiffness_n_per_m: Matrix3::from_diagonal_element(500.0),
        ..floor()
    };
    let rendered = hold_still(&mut core, &slanted, &update(1, Some(model)), 3000);
    let last_n = rendered.last().unwrap().force_n;
    assert!((last_n - Vector3::new(1.0, 1.0, 0.0).normalize()).norm() < 1e-6, "{last_n}");
    assert!(rendered.iter().all(|r| r.force_n.norm() < 1.0 + 1e-9));
}

#[test]
fn the_force_never_changes_faster_than_its_rate_whatever_happens() {
    let slow = Settings { slew_n_per_s: 100.0, ..settings() };
    let mut core = in_contact(slow);
    let bad = update(9, Some(LocalModel { force_n: Vector3::repeat(f64::NAN), ..floor() }));
    let good = update(1, Some(floor()));
    let mut rendered = hold_still(&mut core, &hand(-4e-3), &good, 1);
    rendered.extend(hold_still(&mut core, &hand(-4e-3), &bad, 100));
    rendered.extend(hold_still(&mut core, &hand(-4e-3), &update(10, Some(floor())), 1000));
    rendered.push(core.tick(0.0, &hand(-4e-3), None, None));
    rendered.push(core.tick(f64::NAN, &hand(-4e-3), None, None));
    rendered.extend((0..100).map(|_| core.tick(DT_S, &hand(f64::NAN), None, None)));
    assert!(largest_jump_n(&rendered) < 0.1 + 1e-9, "{}", largest_jump_n(&rendered));
    assert_eq!(rendered.last().unwrap().force_n.norm(), 0.0);
}

#[test]
fn the_force_is_let_in_slowly_at_first() {
    let mut core = Core::new(Settings { ramp_s: 0.5, ..settings() });
    let rendered = hold_still(&mut core, &hand(-4e-3), &update(1, Some(floor())), 600);
    assert!(rendered[100].force_n.y < 0.25 * 1.5 && rendered[100].state == State::Ramping, "{:?}", rendered[100]);
    assert!(rendered[599].force_n.y > 0.8 && rendered[599].state == State::Rendering, "{:?}", rendered[599]);
}

#[test]
fn the_force_fades_with_a_stale_model_and_comes_back_slowly() {
    let mut core = in_contact(Settings { ramp_s: 0.5, ..settings() });
    let known = update(1, Some(floor()));
    let aged = |core: &mut Core, tick: usize| {
        core.tick(DT_S, &hand(-4e-3), None, Some(Newest { update: &known, age_s: DT_S * tick as f64, pose_age_s: 0.0 }))
    };
    let fading: Vec<_> = (1..=150).map(|tick| aged(&mut core, tick)).collect();
    assert!((fading[45].force_n.y - 1.5).abs() < 1e-3, "{:?}", fading[45]);
    assert!((fading[74].force_n.y - 0.75).abs() < 0.05, "{:?}", fading[74]);
    assert!(fading[100..].iter().all(|r| r.force_n.norm() == 0.0 && r.state == State::Stale));
    let tool_m = fading[149].tool.unwrap().position_m.y;
    assert!((tool_m + 1e-3).abs() < 1e-4, "the tool stands on what was known last, {tool_m}");
    let back = hold_still(&mut core, &hand(-4e-3), &update(2, Some(floor())), 600);
    assert!(back[50].force_n.y < 0.3, "{:?}", back[50]);
    assert!(back[599].force_n.y > 1.4, "{:?}", back[599]);
}

/// A hand that leans 12 mm into tissue that stiffens, through a network of 100 ms that stalls for 0.2 s after 2 s: how deep
/// the tool was before the stall and after it, and how far the hand swings once force is rendered in full again, m.
fn stall() -> [f64; 3] {
    const WAY: u64 = 100;
    let no_schedule =
        CouplingLimits { min_stiffness_n_per_m: 48.0, max_stiffness_n_per_m: 48.0, ..settings().coupling };
    let passivity = Some(PassivityLimits { max_damping_n_s_per_m: 5.0, margin_j: 1e-3, max_debt_j: 0.02 });
    let mut core =
        Core::new(Settings { coupling: no_schedule, passivity, ramp_s: 0.5, peak_force_n: 3.3, ..settings() });
    let (mass_kg, mut y_m, mut v_m_per_s) = (0.1, 0.0, 0.0);
    let mut way: VecDeque<f64> = std::iter::repeat_n(0.0, WAY as usize).collect();
    let (mut known, mut came) = (update(1, None), 0);
    let (mut before_m, mut after_m, mut swing_m) = (0.0_f64, 0.0_f64, [f64::MAX, f64::MIN]);
    for step in 1..5000_u64 {
        // The tool goes in within 1 s: so slowly that it does not swing.
        let wanted_m = -12e-3 * (step as f64 * DT_S).min(1.0);
        let at_m = way.pop_front().unwrap();
        if step % 4 == 0 && !(2000..2200).contains(&step) {
            let depth_m = (-at_m).max(0.0);
            // 30 N/m, and four times that at 10 mm.
            let [force_n, stiffness] = [depth_m, 1.0].map(|x| 30.0 * x * (1.0 + (depth_m / 0.01).powi(2)));
            let model = LocalModel {
                reference: at(0.0, at_m, 0.0),
                force_n: Vector3::y() * force_n,
                stiffness_n_per_m: Matrix3::from_diagonal_element(stiffness),
                ..floor()
            };
            (known, came) = (update(step, (depth_m > 0.0).then_some(model)), step);
        }
        let age_s = DT_S * (step - came) as f64;
        let hand = Hand { pose: at(0.0, y_m, 0.0), velocity_m_per_s: Vector3::y() * v_m_per_s };
        let newest = Newest { update: &known, age_s, pose_age_s: age_s + DT_S * WAY as f64 };
        let rendered = core.tick(DT_S, &hand, None, Some(newest));
        let tool_m = rendered.tool.unwrap().position_m.y;
        way.push_back(tool_m);
        let hand_n = 200.0 * (wanted_m - y_m) - v_m_per_s;
        v_m_per_s += DT_S * (rendered.force_n.y + hand_n) / mass_kg;
        y_m += DT_S * v_m_per_s;
        match step {
            1500..2000 => before_m = before_m.max(-tool_m),
            2000..3000 => after_m = after_m.max(-tool_m),
            _ if step > 2000 && rendered.state == State::Rendering => {
                swing_m = [swing_m[0].min(y_m), swing_m[1].max(y_m)];
            }
            _ => {}
        }
    }
    [before_m, after_m, swing_m[1] - swing_m[0]]
}

#[test]
fn a_stall_does_not_press_the_tool_into_what_is_not_felt_meanwhile() {
    let [before_m, after_m, swing_m] = stall();
    assert!(before_m > 3e-3, "{before_m}");
    assert!(after_m < 1.3 * before_m, "{after_m} m deep after {before_m} m");
    assert!(swing_m < 5e-4, "{swing_m} m");
}

#[test]
fn numbers_that_are_none_trip_the_servo_with_a_word_and_it_comes_back() {
    let bad = update(2, Some(LocalModel { stiffness_n_per_m: Matrix3::repeat(f64::NAN), ..floor() }));
    let good = update(3, Some(floor()));
    let cases = [(hand(-4e-3), bad, Fault::ModelNotFinite), (hand(f64::NAN), good, Fault::HandNotFinite)];
    for (hand_now, update_now, fault) in cases {
        let mut core = in_contact(Settings { ramp_s: 0.5, ..settings() });
        let tripped = hold_still(&mut core, &hand_now, &update_now, 5);
        assert!(tripped.iter().all(|r| r.force_n.norm() == 0.0 && r.state == State::Tripped(fault)), "{tripped:?}");
        assert!(tripped.iter().all(|r| r.tool.is_none()), "no pose is sent");
        let back = hold_still(&mut core, &hand(-4e-3), &update(4, Some(floor())), 6000);
        assert!(back[..240].iter().all(|r| r.force_n.norm() == 0.0), "held back for a while");
        assert!((back.last().unwrap().force_n.y - 1.5).abs() < 0.01, "{:?}", back.last());
        assert_eq!(back.last().unwrap().faults, (Some(fault), 1));
    }
}

#[test]
fn a_force_that_overflows_trips_the_servo() {
    let mut core = Core::new(settings());
    let huge = LocalModel {
        force_n: Vector3::repeat(1e308),
        stiffness_n_per_m: Matrix3::zeros(),
        damping_n_s_per_m: Matrix3::from_diagonal_element(-1e300),
        ..floor()
    };
    let rendered = hold_still(&mut core, &hand(0.0), &update(1, Some(huge)), 300);
    assert!(rendered.iter().all(|r| r.force_n.norm() <= 100.0 + 1e-9));
    assert!(rendered.iter().any(|r| r.state == State::Tripped(Fault::ForceNotFinite)));
}

#[test]
fn a_gap_a_clock_that_jumps_and_a_hand_that_jumps_trip_the_servo() {
    let known = update(1, Some(floor()));
    let newest = Some(Newest { update: &known, age_s: 0.0, pose_age_s: 0.0 });
    let cases = [(0.5, -4e-3, Fault::Gap), (-1.0, -4e-3, Fault::Gap), (0.0, -4e-3, Fault::Gap)];
    for (dt_s, y_m, fault) in cases.into_iter().chain([(DT_S, -0.2, Fault::HandJumped)]) {
        let mut core = in_contact(settings());
        let jumped = core.tick(dt_s, &hand(y_m), None, newest);
        assert_eq!((jumped.state, jumped.faults), (State::Tripped(fault), (Some(fault), 1)));
        let after = core.tick(DT_S, &hand(y_m), None, newest);
        assert_eq!(after.force_n.norm(), 0.0, "{fault:?}");
    }
}

#[test]
fn nothing_is_rendered_while_the_dead_mans_button_is_up() {
    let mut core = in_contact(Settings { fade_s: 0.05, ..settings() });
    let known = update(1, Some(floor()));
    let newest = Some(Newest { update: &known, age_s: 0.0, pose_age_s: 0.0 });
    let up: Vec<_> = (0..60).map(|_| core.tick(DT_S, &hand(-4e-3), Some(Hold::DeadMan), newest)).collect();
    assert!(up[10].force_n.y > 0.5 && up[59].force_n.norm() == 0.0, "{:?}", up[10]);
    assert_eq!(up[59].state, State::Held(Hold::DeadMan));
}

#[test]
fn a_new_model_changes_the_force_over_its_blend() {
    let mut core = in_contact(settings());
    let stronger = LocalModel { force_n: Vector3::y() * 2.0, ..floor() };
    let rendered = hold_still(&mut core, &hand(-4e-3), &update(2, Some(stronger)), 400);
    // 1 N more at the tool, over 8 steps; half of it comes to the hand, which is coupled as stiffly as the floor.
    assert!(rendered[0].force_n.y < 1.51, "{:?}", rendered[0]);
    assert!(largest_jump_n(&rendered) < 1.0 / 8.0, "{}", largest_jump_n(&rendered));
    assert!((rendered[399].force_n.y - 2.0).abs() < 1e-3, "{:?}", rendered[399]);
}

#[test]
fn a_slow_network_makes_the_coupling_softer() {
    let force_n = |round_trip_s| {
        let mut core = Core::new(settings());
        let update = Update { round_trip_s, ..update(1, Some(floor())) };
        hold_still(&mut core, &hand(-4e-3), &update, 8000).last().unwrap().force_n.y
    };
    // Series of 500 N/m with 500, 50 and 20 N/m.
    assert!((force_n(2e-3) - 1.5).abs() < 1e-3);
    assert!(force_n(0.1) < 0.3, "{}", force_n(0.1));
    assert!(force_n(0.3) < 0.12, "{}", force_n(0.3));
}

#[test]
fn a_capped_contact_renders_no_more_than_its_cap() {
    // Down at 0.1 m/s to 0.1 m, slowly on, and 1 mm back: the last force going in, and the one there.
    let forces_n = |model: LocalModel| {
        let (mut core, known) = (Core::new(settings()), update(1, Some(model)));
        let mut at = |y_m: f64| hold_still(&mut core, &hand(y_m), &known, 1).last().unwrap().force_n.y;
        (0..1000).for_each(|tick| _ = at(-1e-4 * f64::from(tick)));
        let deep_n = (0..8000).map(|tick| at(-0.1 - 1e-6 * f64::from(tick))).last().unwrap();
        let back_n = (0..1000).map(|tick| at(-0.108 + 1e-6 * f64::from(tick))).last().unwrap();
        [deep_n, back_n]
    };
    let capped = LocalModel { along: Along::Yields { direction: Vector3::y(), cap_n: 1.2, give: None }, ..floor() };
    // 250 N/m of coupling and floor in series let go over the millimetre at once.
    let [deep_n, back_n] = forces_n(capped);
    assert!((deep_n - 1.2).abs() < 0.01 && (back_n - 0.95).abs() < 0.01, "{deep_n} N, and {back_n} N");
    // 1 N + 500 N/m * 108 mm, halved by a coupling as stiff as the floor.
    let [deep_n, back_n] = forces_n(floor());
    assert!((deep_n - 27.5).abs() < 0.02 && (back_n - 27.25).abs() < 0.02, "{deep_n} N, and {back_n} N");
}

#[test]
fn a_cut_begins_in_the_step_in_which_the_model_says_so() {
    let give = Some(Give { at_n: 1.2, left_n: 0.6 });
    let model = LocalModel { along: Along::Yields { direction: Vector3::y(), cap_n: 1.25, give }, ..floor() };
    let known = update(1, Some(model));
    let mut core = Core::new(settings());
    let mut forces_n = Vec::new();
    for tick in 0..4000_u64 {
        let hand = hand(-1e-6 * tick as f64);
        let newest = Newest { update: &known, age_s: 0.0, pose_age_s: 1.0 };
        forces_n.push(core.tick(DT_S, &hand, None, Some(newest)).force_n.y);
    }
    let fell = forces_n.windows(2).position(|pair| pair[1] < pair[0] - 0.1).expect("it falls");
    assert!((forces_n[fell] - 1.2).abs() < 0.01, "{}", forces_n[fell]);
    assert!((forces_n[fell + 1] - 0.6).abs() < 0.01 && forces_n[fell + 1..].iter().all(|n| *n < 0.61));
}

/// A light hand that leans on a floor of 300 N/m which answers 40 ms late, with a force and no model of how it changes:
/// how far it swings in the end, mm, and the most energy that was given out, mJ.
fn lean(passivity: Option<PassivityLimits>) -> (f64, f64) {
    let no_schedule = CouplingLimits { min_stiffness_n_per_m: 500.0, ..settings().coupling };
    let mut core = Core::new(Settings { passivity, coupling: no_schedule, peak_force_n: 3.3, ..settings() });
    let (mass_kg, mut y_m, mut v_m_per_s) = (0.1, 0.0, 0.0);
    let mut way: VecDeque<f64> = std::iter::repeat_n(0.0, 40).collect();
    let mut last: Vec<f64> = Vec::new();
    for step in 1..6000 {
        let reference_m = way.pop_front().unwrap();
        let model = LocalModel {
            reference: at(0.0, reference_m, 0.0),
            force_n: Vector3::y() * (-300.0 * reference_m).max(0.0),
            stiffness_n_per_m: Matrix3::zeros(),
            ..floor()
        };
        let update = update(step, Some(model));
        let hand = Hand { pose: at(0.0, y_m, 0.0), velocity_m_per_s: Vector3::y() * v_m_per_s };
        let rendered = core.tick(DT_S, &hand, None, Some(Newest { update: &update, age_s: 0.0, pose_age_s: 0.0 }));
        way.push_back(rendered.tool.unwrap().position_m.y);
        // A light grip that rests at 5 mm below the floor.
        let hand_n = 50.0 * (-5e-3 - y_m) - 0.5 * v_m_per_s;
        v_m_per_s += DT_S * (rendered.force_n.y + hand_n) / mass_kg;
        y_m += DT_S * v_m_per_s;
        if step > 5000 {
            last.push(1e3 * y_m);
        }
    }
    let swing_mm = last.iter().copied().fold(f64::MIN, f64::max) - last.iter().copied().fold(f64::MAX, f64::min);
    (swing_mm, 1e3 * core.passivity.map_or(0.0, |passivity| passivity.generated_j()))
}

#[test]
fn what_shakes_without_passivity_control_is_calm_with_it() {
    let limits = PassivityLimits { max_damping_n_s_per_m: 20.0, margin_j: 1e-4, max_debt_j: 0.02 };
    let (without_mm, _) = lean(None);
    let (with_mm, given_mj) = lean(Some(limits));
    assert!(without_mm > 3.0, "{without_mm} mm");
    assert!(with_mm < 0.2 * without_mm, "{with_mm} mm, {given_mj} mJ");
}
