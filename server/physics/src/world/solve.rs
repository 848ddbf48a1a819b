//! The velocity solve: bodies that press on each other as one system, contacts re-solved until they stay.

use super::World;
use super::tissue_contact::Island;
use crate::contact::Solution;
use crate::solve::pcg;
use crate::step_io::SolveReport;
use crate::workers::Workers;

/// A step's contact springs are re-solved at most this many times; what still changes then waits for the next step.
/// Ours: nearly every step of a stroke takes 1 to 3 solves, none more than 5. Half of it moves the force of slicing by
/// 0.3 % of its peak, rms; twice changes no bit.
const MAX_ACTIVE_SET_SOLVES: u32 = 6;

impl World {
    pub(super) fn solve_velocities(&mut self, workers: &Workers<'_>) {
        for (index, slot) in self.slots.iter_mut().enumerate() {
            slot.island = index;
            if !slot.is_asleep() {
                slot.body.refresh_operator(workers);
                slot.body.assemble_right_side(workers);
            }
        }
        if let Some(tissue) = &self.tissue {
            tissue.number_islands(&mut self.slots);
        }
        let mut report = SolveReport::default();
        for island in 0..self.slots.len() {
            if self.slots[island].island == island && !self.slots[island].is_asleep() {
                self.solve_island(workers, island, &mut report);
            }
        }
        self.correct_momentum();
        self.output.solve = report;
    }

    /// Free parts keep their momentum whatever the tolerance of the solve.
    fn correct_momentum(&mut self) {
        let mut is_missing = false;
        for slot in self.slots.iter_mut().filter(|slot| !slot.is_asleep()) {
            slot.ledger.momentum_j = 0.0;
            let touched = slot.impulses[..slot.tool_impulses].iter().map(|i| i.0);
            is_missing |= slot.body.sum_missing_momentum(touched, &slot.velocity_change);
        }
        if !is_missing {
            return;
        }
        if let Some(tissue) = &mut self.tissue {
            tissue.join_parts(&mut self.slots);
        }
        for slot in self.slots.iter_mut().filter(|slot| !slot.is_asleep()) {
            slot.ledger.momentum_j = slot.body.add_missing_motion(&mut slot.velocity_change);
        }
    }

    fn solve_island(&mut self, workers: &Workers<'_>, id: usize, report: &mut SolveReport) {
        let dt_s = self.params.dt_s;
        for round in 0..MAX_ACTIVE_SET_SOLVES {
            let mut scale2 = 0.0;
            for (index, slot) in self.slots.iter_mut().enumerate().filter(|(_, slot)| slot.island == id) {
                let impulses = self.tissue.iter().flat_map(|tissue| tissue.impulses(index, dt_s));
                let springs = self.tissue.iter().flat_map(|tissue| tissue.point_springs(index, dt_s));
                scale2 += slot.load_system(workers, (impulses, springs), dt_s).powi(2);
            }
            let scale = scale2.sqrt();
            for slot in self.slots.iter_mut().filter(|slot| slot.island == id) {
                slot.applied_n_s = scale;
            }
            if let Some(tissue) = &mut self.tissue {
                tissue.build_bridges(&self.slots, dt_s);
            }
            let stop = self.slots[id].body.stop(scale);
            let may_change = round + 1 < MAX_ACTIVE_SET_SOLVES;
            let mut island = Island { slots: &mut self.slots, tissue: self.tissue.as_mut(), id, dt_s, may_change };
            let solve = pcg::solve(workers, &mut island, stop);
            report.iterations += solve.iterations;
            report.solves += 1;
            if solve.is_moot {
                continue;
            }
            report.relative_residual = report.relative_residual.max(solve.relative_residual);
            let wrong_n_s = island.settle(workers, Solution::Final).norm_n_s();
            if wrong_n_s <= solve.tolerance_n_s {
                break;
            }
        }
    }
}
