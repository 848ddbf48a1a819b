//! Steps whose solve fell short: told from time to time, with the worst of them.

use kerf_physics::step_io::SolveReport;

/// Told at most so often, ns: a body in trouble falls short in step after step.
const INTERVAL_NS: u64 = 1_000_000_000;

/// What steps fell short by since that was last told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shortfall {
    /// How many there were.
    pub steps: u32,
    /// Largest relative residual that a solve was left with.
    pub relative_residual: f64,
    /// Largest norm of the impulses by which contacts were wrong, N s.
    pub unsettled_n_s: f64,
}

/// Whether a step's solves fell short of what was asked of them. Where its work was used up that is asked for, and told as
/// such.
pub(crate) fn falls_short(solve: &SolveReport) -> bool {
    solve.is_unconverged || solve.unsettled_n_s > 0.0 && !solve.is_cut_short
}

/// Watches the solves of a session.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShortfallWatch {
    untold: Shortfall,
    told_ns: Option<u64>,
}

impl ShortfallWatch {
    /// A step has ended. The first that falls short is told at once, others with the next that is due.
    pub fn step_ended(&mut self, ended_ns: u64, solve: &SolveReport) -> Option<Shortfall> {
        if falls_short(solve) {
            let untold = &mut self.untold;
            untold.steps += 1;
            untold.relative_residual = untold.relative_residual.max(solve.relative_residual);
            untold.unsettled_n_s = untold.unsettled_n_s.max(solve.unsettled_n_s);
        }
        let is_due = self.told_ns.is_none_or(|told_ns| ended_ns.saturating_sub(told_ns) >= INTERVAL_NS);
        (is_due && self.untold.steps > 0).then(|| {
            self.told_ns = Some(ended_ns);
            std::mem::take(&mut self.untold)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solve_that_falls_short_is_told_at_once_and_those_after_it_once_a_second() {
        let mut watch = ShortfallWatch::default();
        let sound = SolveReport { relative_residual: 1e-3, ..SolveReport::default() };
        let short = |residual| SolveReport { relative_residual: residual, is_unconverged: true, ..sound };
        assert_eq!(watch.step_ended(0, &sound), None);
        let first = watch.step_ended(1_000_000, &short(0.1)).expect("told at once");
        assert_eq!((first.steps, first.relative_residual), (1, 0.1));
        let of_later = (2..2_002).filter_map(|ms| watch.step_ended(ms * 1_000_000, &short(ms as f64)));
        let later: Vec<Shortfall> = of_later.collect();
        assert_eq!(later.iter().map(|told| told.steps).collect::<Vec<_>>(), [1000, 1000]);
        assert_eq!(later[0].relative_residual, 1001.0);
        let unsettled = SolveReport { unsettled_n_s: 0.5, ..sound };
        assert_eq!(watch.step_ended(4_000_000_000, &unsettled).map(|told| told.unsettled_n_s), Some(0.5));
        assert_eq!(watch.step_ended(6_000_000_000, &sound), None);
        let budgeted = SolveReport { is_cut_short: true, ..unsettled };
        assert_eq!(watch.step_ended(8_000_000_000, &budgeted), None);
    }
}
