//! The velocity solve: bodies that press on each other as one system, contacts re-solved until they stay.

use super::state::State;
use super::tissue_contact::Island;
use crate::contact::Solution;
use crate::solve::pcg::{self, PcgReport, Stop};
use crate::step_io::SolveReport;
use crate::work::WorkMeter;
use crate::workers::Workers;

/// A step's contact springs are re-solved at most this many times until they may only let go.
/// Ours: nearly every step of a stroke takes 1 to 3 solves, none more than 5. Half of it moves the force of slicing by
/// 0.3 % of its peak, rms; twice changes no bit.
const MAX_ACTIVE_SET_SOLVES: u32 = 6;
/// And so many times though the step's work is used up. Ours: with two, forces of slicing are 4 to 7 % off.
const LEAST_SOLVES: u32 = 3;

/// And from then on at most this many times. Ours: each lets go of all that pulls, so that hardly ever a third is taken.
const MAX_LETTING_GO_SOLVES: u32 = 6;

impl SolveReport {
    fn add(&mut self, solve: &PcgReport) {
        self.iterations += solve.iterations;
        self.solves += 1;
    }

    /// Takes what the last solve of an island left, and by how much its contacts are wrong still, N s.
    fn end_island(&mut self, solve: &PcgReport, relative_tolerance: f64, unsettled_n_s: f64) {
        self.relative_residual = self.relative_residual.max(solve.relative_residual);
        self.is_cut_short |= solve.is_converged && solve.relative_residual > relative_tolerance;
        self.is_unconverged |= !solve.is_converged;
        self.unsettled_n_s = self.unsettled_n_s.hypot(unsettled_n_s);
    }
}

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

/// Solves an island until its contacts did what its solution says that they should have done. Those that go on changing
/// only let go from then on, so that none is left that pulls; what is missing of pushes waits for the next step, and is
/// reported.
fn solve_island(
    workers: &Workers<'_>,
    (id, dt_s): (usize, f64),
    state: &mut State,
    work: &mut WorkMeter,
    report: &mut SolveReport,
) {
    let mut letting_go_solves = 0;
    for round in 1.. {
        let may_change = round < MAX_ACTIVE_SET_SOLVES && !(round >= LEAST_SOLVES && work.is_spent());
        let solve = solve_round(workers, &mut state.island(id, dt_s, may_change), work, report);
        if solve.is_moot {
            continue;
        }
        let solution = if letting_go_solves == 0 { Solution::Final } else { Solution::LettingGo };
        let wrong = state.island(id, dt_s, may_change).settle(workers, solution);
        let is_settled = !wrong.exceeds(solve.tolerance_n_s);
        let lets_go = wrong.too_much_n_s() > solve.tolerance_n_s && letting_go_solves < MAX_LETTING_GO_SOLVES;
        if is_settled || !may_change && !lets_go {
            let relative_tolerance = state.slots[id].body.relative_tolerance();
            report.is_cut_short |= !is_settled && work.is_spent();
            report.end_island(&solve, relative_tolerance, if is_settled { 0.0 } else { wrong.norm_n_s() });
            return;
        }
        letting_go_solves += u32::from(!may_change);
    }
}

/// One solve of an island with its contacts as they are. One that does not get to its tolerance is taken up once more
/// with a preconditioner made anew.
fn solve_round(
    workers: &Workers<'_>,
    island: &mut Island<'_>,
    work: &mut WorkMeter,
    report: &mut SolveReport,
) -> PcgReport {
    let solve = island.solve(workers, work, report);
    if solve.is_moot || solve.is_converged {
        return solve;
    }
    for slot in island.slots.iter_mut().filter(|slot| slot.scratch.island == island.id) {
        slot.body.take_velocity_change(workers, &mut slot.velocity_change);
        slot.body.renew_preconditioner(workers);
    }
    report.retries += 1;
    island.solve(workers, work, report)
}

impl Island<'_> {
    fn solve(&mut self, workers: &Workers<'_>, work: &mut WorkMeter, report: &mut SolveReport) -> PcgReport {
        let of_island = self.slots.iter().filter(|slot| slot.scratch.island == self.id);
        let elements = of_island.map(|slot| slot.body.base().elements.len()).sum();
        let stop = Stop { effort: work.effort(elements), ..self.load(workers) };
        let solve = pcg::solve(workers, self, stop);
        report.add(&solve);
        work.add_solve(elements, solve.iterations);
        solve
    }

    /// Loads the solver with the contacts as they are; returns when the solve ends.
    fn load(&mut self, workers: &Workers<'_>) -> Stop {
        let Self { slots, tissue, id, dt_s, .. } = self;
        let mut scale2 = 0.0;
        for (index, slot) in slots.iter_mut().enumerate().filter(|(_, slot)| slot.scratch.island == *id) {
            let impulses = tissue.iter().flat_map(|tissue| tissue.impulses(index, *dt_s));
            let springs = tissue.iter().flat_map(|tissue| tissue.point_springs(index, *dt_s));
            scale2 += slot.load_system(workers, (impulses, springs), *dt_s).powi(2);
        }
        for slot in slots.iter_mut().filter(|slot| slot.scratch.island == *id) {
            slot.applied_n_s = scale2.sqrt();
        }
        if let Some(tissue) = tissue {
            tissue.build_bridges(slots, *dt_s);
        }
        slots[*id].body.stop(scale2.sqrt())
    }
}

impl State {
    /// The bodies of an island, with what presses between them.
    fn island(&mut self, id: usize, dt_s: f64, may_change: bool) -> Island<'_> {
        Island { slots: &mut self.slots, tissue: self.tissue.as_mut(), id, dt_s, may_change }
    }
}
