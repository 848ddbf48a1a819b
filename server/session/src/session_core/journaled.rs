//! Sessions that are killed and brought back by their journals, in virtual time.

use std::sync::Arc;

use kerf_physics::SceneDesc;

use super::lock_step::{steps, stroke};
use super::virtual_session::{MS, S, VirtualSession};
use crate::error::SessionError;
use crate::inbox::CheckpointCommand::{Delete, Restore, Save};
use crate::inbox::Command;
use crate::past::{Past, PastEntry};
use crate::status::Phase;
use crate::tape::TapeEntry;

fn block() -> SceneDesc {
    toml::from_str(include_str!("../../tests/block.toml")).unwrap()
}

fn journaled(past: Option<Past>) -> VirtualSession {
    VirtualSession::journaled(block(), past).unwrap()
}

fn taken(session: &VirtualSession) -> Vec<TapeEntry> {
    session.journal.as_ref().unwrap().take().0.into()
}

/// What files say of these entries.
fn past(entries: &[TapeEntry]) -> Past {
    let mut past = Past::default();
    for entry in entries {
        match entry {
            TapeEntry::Step(taped) => past.entries.push(PastEntry::Step {
                step: taped.report.step,
                inputs: taped.inputs.clone(),
                state_hash: taped.state_hash,
            }),
            TapeEntry::Event(happened) => past.entries.push(PastEntry::Event(happened.event.clone())),
            TapeEntry::Checkpoint(name, file) => {
                past.entries.push(PastEntry::Checkpoint(Arc::clone(name), file.save()));
            }
            TapeEntry::Base(base) => {
                past = Past { base: Some(base.state.save()), is_paused: base.is_paused, ..Past::default() };
                let kept =
                    base.checkpoints.iter().map(|(name, kept)| PastEntry::Checkpoint(Arc::clone(name), kept.save()));
                past.entries.extend(kept);
            }
        }
    }
    past
}

fn bases(entries: &[TapeEntry]) -> usize {
    entries.iter().filter(|entry| matches!(entry, TapeEntry::Base(_))).count()
}

#[test]
fn a_session_that_is_killed_in_mid_cut_is_back_at_the_same_step_with_the_same_state_and_energy() {
    let mut session = journaled(None);
    // Steps that take all their time: after half a thousand of them taking them once more would take a second.
    session.step_ns = 2 * MS;
    let driver = session.drive();
    let mut entries = Vec::new();
    for cut in 0..12 {
        session.cut(driver, 100 * cut + 1..100 * cut + 61);
        entries.extend(taken(&session));
        let was = session.status();
        let mut back = journaled(Some(past(&entries)));
        let is = back.status();
        assert_eq!((is.step, is.state_hash, is.energy), (was.step, was.state_hash, was.energy), "cut {cut}");
        assert!(was.step > 0 && is.phase == Phase::Running);
        // The hand is gone with the server; it comes back, and goes on.
        back.run(10 * MS);
        assert!(back.core.world().tool_places().all(|place| place.is_none()), "nobody holds the blade");
        let driver = back.drive();
        back.cut(driver, 1..61);
        assert!(back.status().energy.tool_work_j != was.energy.tool_work_j);
    }
    let (steps, bases) = (session.status().step, bases(&entries));
    println!("{bases} states to go on from in {steps} steps");
    assert!((1..=(steps / 500) as usize).contains(&bases), "{bases} in {steps} steps");
}

#[test]
fn every_prefix_of_a_journal_leads_to_where_the_session_stood_then() {
    let mut session = journaled(None);
    let driver = session.drive();
    session.cut(driver, 1..41);
    session.ask(|answer| Command::Checkpoint(Save("half way".into(), answer))).unwrap();
    session.cut(driver, 101..141);
    session.ask(|answer| Command::Checkpoint(Restore("half way".into(), answer))).unwrap();
    session.run(20 * MS);
    session.ask(Command::Reset).unwrap();
    session.cut(driver, 201..221);
    session.ask(|answer| Command::Checkpoint(Restore("half way".into(), answer))).unwrap();
    session.run(20 * MS);
    let end = session.status();
    // Each step of the whole journal has its hash, as a recording is made beside it.
    let entries = taken(&session);
    for end in (0..entries.len()).step_by(7) {
        let mut back = journaled(Some(past(&entries[..end])));
        let last = entries[..end].iter().rev().find_map(|entry| match entry {
            TapeEntry::Step(taped) => Some((taped.report.step, taped.state_hash)),
            _ => None,
        });
        let is = back.status();
        let moved = entries[..end].iter().rev().take_while(|entry| !matches!(entry, TapeEntry::Step(_)));
        if moved.clone().count() == 0
            && let Some(last) = last
        {
            assert_eq!((is.step, Some(is.state_hash)), last, "after {end} entries");
        }
    }
    let mut back = journaled(Some(past(&entries)));
    let is = back.status();
    assert_eq!((is.step, is.state_hash), (end.step, end.state_hash));
    let again = [session, back].map(|mut session| {
        session.ask(|answer| Command::Checkpoint(Restore("half way".into(), answer))).unwrap();
        session.ask(|answer| Command::Checkpoint(Save("again".into(), answer))).unwrap()
    });
    assert_eq!(again[0], again[1]);
}

#[test]
fn a_session_that_stood_stands_and_forgets_what_it_had_forgotten() {
    let mut session = journaled(None);
    let driver = session.drive();
    session.cut(driver, 1..31);
    session.ask(|answer| Command::Checkpoint(Save("a".into(), answer))).unwrap();
    session.ask(|answer| Command::Checkpoint(Save("b".into(), answer))).unwrap();
    session.ask(Command::Pause);
    session.ask(|answer| Command::Checkpoint(Delete("a".into(), answer))).unwrap();
    let was = session.status();
    let entries = taken(&session);
    assert_eq!(bases(&entries), 1, "none says of a checkpoint that it is gone");
    let mut back = journaled(Some(past(&entries)));
    back.run(S);
    let is = back.status();
    assert_eq!((is.phase, is.step, is.state_hash), (Phase::Paused, was.step, was.state_hash));
    let restored = |session: &mut VirtualSession, name: &str| {
        session.ask(|answer| Command::Checkpoint(Restore(name.into(), answer))).is_ok()
    };
    assert!(!restored(&mut back, "a") && restored(&mut back, "b"));
}

#[test]
fn steps_that_calls_ask_for_go_on_to_the_same_bits() {
    let stroke = stroke();
    let (first, second) = stroke.split_at(60);
    let mut session = journaled(None);
    session.ask(Command::Pause);
    session.ask(Command::Reset).unwrap();
    session.step_by(steps(first)).unwrap();
    let entries = taken(&session);
    let once = session.step_by(steps(second)).unwrap();
    let mut back = journaled(Some(past(&entries)));
    assert_eq!(back.step_by(steps(second)).unwrap(), once, "the blade is where calls had put it");
}

#[test]
fn a_journal_that_leads_elsewhere_brings_nothing_back_and_says_where() {
    let mut session = journaled(None);
    let driver = session.drive();
    session.cut(driver, 1..41);
    let entries = taken(&session);
    let refusal = |past: Past| match VirtualSession::journaled(block(), Some(past)) {
        Err(SessionError::Unrecoverable { message }) => message,
        other => panic!("{:?}", other.err()),
    };
    let mut other = past(&entries);
    let hash = other.entries.iter_mut().rev().find_map(|entry| match entry {
        PastEntry::Step { state_hash: Some(hash), .. } => Some(hash),
        _ => None,
    });
    *hash.unwrap() ^= 1;
    assert!(refusal(other).contains("the state that it leads to has the hash"));
    let mut gap = past(&entries);
    gap.entries.retain(|entry| !matches!(entry, PastEntry::Step { step: 7, .. }));
    assert!(refusal(gap).contains("step 8 is recorded where step 7 should be"));
    let broken = Past { base: Some(vec![1, 2, 3]), ..Past::default() };
    assert!(!refusal(broken).is_empty());
}
