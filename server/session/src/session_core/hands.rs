//! What hands do to tissue through bursts of poses, resets and ways back, in virtual time.

use kerf_physics::step_io::ToolMotion;

use super::virtual_session::{MS, S, VirtualSession};
use crate::inbox::CheckpointCommand::{Restore, Save};
use crate::inbox::Command;
use crate::limits::SessionLimits;
use crate::step_report::{StepReport, ToolReport};
use crate::tape::TapeEntry;
use crate::tool_slot::DriverId;

/// Above the block, and with the edge's middle 5 mm deep in it.
const ABOVE_M: f64 = 0.015;
const DEEP_M: f64 = 0.005;

fn session() -> VirtualSession {
    VirtualSession::new(toml::from_str(include_str!("../../tests/block.toml")).unwrap(), SessionLimits::default())
}

fn felt(session: &VirtualSession) -> ToolReport {
    session.reports.borrow().tools[0]
}

fn force_n(session: &VirtualSession) -> f64 {
    felt(session).output.wrench.force_n.norm()
}

fn tool_work_j(session: &mut VirtualSession) -> f64 {
    session.status().energy.tool_work_j
}

/// A hand that goes down through the air into the block and stays.
fn deep(session: &mut VirtualSession) -> DriverId {
    let driver = session.drive();
    for seq in 1..=100 {
        session.submit(driver, seq, ABOVE_M - (ABOVE_M - DEEP_M) * seq as f64 / 100.0).unwrap();
        session.run(2 * MS);
    }
    assert!(force_n(session) > 0.05, "{} N", force_n(session));
    driver
}

/// Steps of the tape, with the reports of them.
fn steps(entries: &[TapeEntry]) -> impl Iterator<Item = (&StepReport, Option<ToolMotion>)> {
    entries.iter().filter_map(|entry| match entry {
        TapeEntry::Step(taped) => Some((&taped.report, taped.inputs.tools.first().map(|input| input.motion))),
        TapeEntry::Event(_) | TapeEntry::Checkpoint(..) | TapeEntry::Base(_) => None,
    })
}

/// Longest way of the tool's reference point within a step, m.
fn longest_step_m(entries: &[TapeEntry]) -> f64 {
    let places: Vec<_> = steps(entries).map(|(report, _)| report.tools[0].output.pose).collect();
    let ways = places.windows(2).filter_map(|pair| Some((pair[1]?.position_m - pair[0]?.position_m).norm()));
    ways.fold(0.0, f64::max)
}

#[test]
fn poses_that_arrive_in_a_burst_do_no_more_than_a_hand_at_the_limit_of_speed() {
    // Each 1.9 mm after the one before, 22.8 mm in all: within the slack one by one.
    let way = |seq: u64| 0.0075 - 0.0019 * seq as f64;
    let stroke = |burst: bool| {
        let mut session = session();
        let driver = deep(&mut session);
        session.submit(driver, 101, 0.0075).unwrap();
        session.run(20 * MS);
        let before_j = tool_work_j(&mut session);
        for seq in 1..=12 {
            session.submit(driver, 101 + seq, way(seq)).unwrap();
            if !burst && seq % 3 == 0 {
                session.run(2 * MS);
            }
        }
        session.run(20 * MS);
        let work_j = tool_work_j(&mut session) - before_j;
        assert_eq!(session.reports.borrow().tools[0].jumps, 0);
        (work_j, longest_step_m(&session.resimulated()))
    };
    let (burst_j, longest_m) = stroke(true);
    // Three poses a step are 5.7 mm, a little less than the limit allows.
    let (paced_j, _) = stroke(false);
    println!("{burst_j:.2e} J in a burst, {paced_j:.2e} J at the limit of speed; {longest_m:.2e} m in a step");
    assert!(longest_m <= 3.0 * 2e-3 * (1.0 + 1e-12), "{longest_m} m in a step of 2 ms");
    assert!(burst_j <= 1.1 * paced_j, "{burst_j} J in a burst, {paced_j} J at the limit of speed");
}

#[test]
fn a_burst_that_is_too_far_to_catch_up_with_lifts_the_tool_until_it_is_clear_and_says_so() {
    let mut session = session();
    let driver = deep(&mut session);
    let before_j = tool_work_j(&mut session);
    // 57 mm and back again to 1 mm below the surface: of the whole burst the newest counts, so it is within reach.
    let burst = |session: &VirtualSession, from: u64, heights_m: &mut dyn Iterator<Item = f64>| {
        heights_m.zip(from..).for_each(|(height_m, seq)| session.submit(driver, seq, height_m).unwrap());
    };
    burst(&session, 101, &mut (1..=30).map(|i| DEEP_M - 0.0019 * f64::from(i)));
    session.run(2 * MS);
    let at = felt(&session);
    assert!(at.output.pose.is_some() && !at.waits && at.jumps == 1, "below the block it is clear: {at:?}");
    burst(&session, 200, &mut (1..=30).map(|i| DEEP_M - 0.0019 * f64::from(30 - i)));
    session.run(2 * MS);
    let at = felt(&session);
    assert!(at.output.pose.is_none() && at.waits, "in the block it is not: {at:?}");
    session.run(S);
    assert_eq!(force_n(&session), 0.0);
    let after_j = tool_work_j(&mut session);
    assert!(after_j <= before_j + 1e-9, "{before_j} J before, {after_j} J after");
    session.submit(driver, 300, ABOVE_M).unwrap();
    session.run(2 * MS);
    let at = felt(&session);
    assert!(at.output.pose.is_some() && !at.waits && at.jumps == 2, "{at:?}");
    session.resimulated();
}

#[test]
fn a_network_that_holds_poses_back_and_a_server_that_stood_still_are_caught_up_with_at_the_limit_of_speed() {
    for stood in [false, true] {
        let mut session = session();
        let driver = deep(&mut session);
        match stood {
            true => session.one_step_of(5 * S),
            false => session.run(300 * MS),
        }
        for seq in 1..=10 {
            session.submit(driver, 100 + seq, DEEP_M - 0.0019 * seq as f64).unwrap();
        }
        session.run(20 * MS);
        let entries = session.resimulated();
        assert!(longest_step_m(&entries) <= 3.0 * 2e-3 * (1.0 + 1e-12));
        assert_eq!(felt(&session).output.pose.map(|pose| pose.position_m.y), Some(DEEP_M - 0.019));
    }
}

#[test]
fn a_hand_that_is_deep_in_an_organ_made_anew_feels_nothing_until_it_is_clear_whatever_made_it_anew() {
    let made_anew: [fn(&mut VirtualSession) -> DriverId; 3] = [
        |session| {
            let driver = deep(session);
            session.ask(Command::Reset).unwrap();
            driver
        },
        |session| {
            session.run(2 * MS);
            session.ask(|answer| Command::Checkpoint(Save("whole".into(), answer))).unwrap();
            let driver = deep(session);
            session.ask(|answer| Command::Checkpoint(Restore("whole".into(), answer))).unwrap();
            driver
        },
        |session| session.drive(),
    ];
    for (index, make_anew) in made_anew.into_iter().enumerate() {
        let mut session = session();
        let driver = make_anew(&mut session);
        // The hand trembles where it is.
        for seq in 1001..1500 {
            session.submit(driver, seq, DEEP_M + 1e-4 * (seq % 3) as f64).unwrap();
            session.run(2 * MS);
            let at = felt(&session);
            assert!(at.waits && at.output.pose.is_none(), "{index}: {at:?}");
            assert_eq!(force_n(&session), 0.0, "{index}");
        }
        assert_eq!(tool_work_j(&mut session), 0.0, "{index}");
        session.run(10 * MS);
        session.submit(driver, 1500, ABOVE_M).unwrap();
        session.run(2 * MS);
        let at = felt(&session);
        assert!(!at.waits && at.output.pose.is_some(), "{index}: {at:?}");
        session.cut(driver, 1501..1550);
        assert!(force_n(&session) > 0.05, "{index}: it is felt again");
        session.resimulated();
    }
}

#[test]
fn a_hand_that_is_where_it_was_at_the_checkpoint_goes_on_from_there() {
    let mut session = session();
    let driver = deep(&mut session);
    session.run(100 * MS);
    let saved_n = force_n(&session);
    session.ask(|answer| Command::Checkpoint(Save("deep".into(), answer))).unwrap();
    for (seq, height_m) in (101..).zip([DEEP_M - 0.002, DEEP_M - 0.004, DEEP_M - 0.002, DEEP_M]) {
        session.submit(driver, seq, height_m).unwrap();
        session.run(20 * MS);
    }
    session.ask(|answer| Command::Checkpoint(Restore("deep".into(), answer))).unwrap();
    session.run(2 * MS);
    let at = felt(&session);
    assert!(!at.waits && at.output.pose.is_some(), "{at:?}");
    assert!(
        (force_n(&session) - saved_n).abs() < 0.01 * saved_n,
        "{saved_n} N when it was saved, {} N",
        force_n(&session)
    );
    session.resimulated();
}

#[test]
fn what_steps_that_were_asked_for_had_put_into_tissue_is_there_again_after_a_way_back() {
    use super::lock_step::{session, steps, stroke};
    let mut session = session();
    let stroke = stroke();
    let (first, second) = stroke.split_at(50);
    session.step_by(steps(first)).unwrap();
    session.ask(|answer| Command::Checkpoint(Save("half way".into(), answer))).unwrap();
    let once = session.step_by(steps(second)).unwrap();
    session.ask(|answer| Command::Checkpoint(Restore("half way".into(), answer))).unwrap();
    assert_eq!(session.step_by(steps(second)).unwrap(), once, "to the bit");
}
