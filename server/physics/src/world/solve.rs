//! The velocity solve: bodies that press on each other as one system, contacts re-solved until they stay.

use super::state::State;
use super::tissue_contact::Island;
use crate::contact::Solution;
use crate::solve::pcg::{self, Stop};
use crate::step_io::SolveReport;
use crate::work::WorkMeter;
use crate::workers::Workers;

/// A step's contact springs are re-solved at most this many times; what still changes then waits for the next step.
/// Ours: nearly every step of a stroke takes 1 to 3 solves, none more than 5. Half of it moves the force of slicing by
/// 0.3 % of its peak, rms; twice changes no bit.
const MAX_ACTIVE_SET_SOLVES: u32 = 6;
/// And so many times though the step's work is used up. Ours: with two, forces of slicing are 4 to 7 % off.
const LEAST_SOLVES: u32 = 3;

/// Solves for the velocities at the end of the step.
pub(super) fn velocities(workers: &Workers<'_>, dt_s: f64, state: &mut State, work: &mut WorkMeter) -> SolveReport {
    work.add_step(state.awake().map(|slot| slot.body.base().elements.len()).sum());
    for (index, slot) in state.slots.iter_mut().enumerate() {
        slot.scratch.island = index;
        if !slot.is_asleep() {
            slot.body.refresh_operator(workers);
            slot.body.assemble_right_side(workers);
        }
    }
    if let Some(tissue) = &state.tissue {
        tissue.number_islands(&mut state.slots);
    }
    let mut report = SolveReport::default();
    for island in 0..state.slots.len() {
        if state.slots[island].scratch.island == island && !state.slots[island].is_asleep() {
            solve_island(workers, (island, dt_s), state, work, &mut report);
        }
    }
    correct_momentum(state);
    report
}

/// Free parts keep their momentum whatever the tolerance of the solve.
fn correct_momentum(state: &mut State) {
    let mut is_missing = false;
    for slot in state.slots.iter_mut().filter(|slot| !slot.is_asleep()) {
        slot.ledger.momentum_j = 0.0;
        let touched = slot.scratch.impulses[..slot.scratch.tool_impulses].iter().map(|i| i.0);
        is_missing |= slot.body.sum_missing_momentum(touched, &slot.velocity_change);
    }
    if !is_missing {
        return;
    }
    if let Some(tissue) = &mut state.tissue {
        tissue.join_parts(&mut state.slots);
    }
    for slot in state.slots.iter_mut().filter(|slot| !slot.is_asleep()) {
        slot.ledger.momentum_j = slot.body.add_missing_motion(&mut slot.velocity_change);
    }
}

fn solve_island(
    workers: &Workers<'_>,
    (id, dt_s): (usize, f64),
    state: &mut State,
    work: &mut WorkMeter,
    report: &mut SolveReport,
) {
    let of_island = state.slots.iter().filter(|slot| slot.scratch.island == id);
    let elements = of_island.map(|slot| slot.body.base().elements.len()).sum();
    for round in 1..=MAX_ACTIVE_SET_SOLVES {
        let is_last = round == MAX_ACTIVE_SET_SOLVES || round >= LEAST_SOLVES && work.is_spent();
        let mut scale2 = 0.0;
        for (index, slot) in state.slots.iter_mut().enumerate().filter(|(_, slot)| slot.scratch.island == id) {
            let impulses = state.tissue.iter().flat_map(|tissue| tissue.impulses(index, dt_s));
            let springs = state.tissue.iter().flat_map(|tissue| tissue.point_springs(index, dt_s));
            scale2 += slot.load_system(workers, (impulses, springs), dt_s).powi(2);
        }
        let scale = scale2.sqrt();
        for slot in state.slots.iter_mut().filter(|slot| slot.scratch.island == id) {
            slot.applied_n_s = scale;
        }
        if let Some(tissue) = &mut state.tissue {
            tissue.build_bridges(&state.slots, dt_s);
        }
        let stop = Stop { effort: work.effort(elements), ..state.slots[id].body.stop(scale) };
        let tissue = state.tissue.as_mut();
        let mut island = Island { slots: &mut state.slots, tissue, id, dt_s, may_change: !is_last };
        let solve = pcg::solve(workers, &mut island, stop);
        report.iterations += solve.iterations;
        report.solves += 1;
        work.add_solve(elements, solve.iterations);
        if solve.is_moot {
            continue;
        }
        report.relative_residual = report.relative_residual.max(solve.relative_residual);
        report.is_cut_short |= solve.relative_residual > stop.relative_tolerance;
        let wrong_n_s = island.settle(workers, Solution::Final).norm_n_s();
        if wrong_n_s <= solve.tolerance_n_s || is_last {
            break;
        }
    }
}
