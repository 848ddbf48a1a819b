//! The input log of a session: all that, with the scene, decides its bits.

use kerf_physics::{NoClock, Scene, SceneError, StepInputs, ToolInput, Workers, World};

/// The inputs of a step, kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedInputs {
    /// See [`StepInputs::tools`].
    pub tools: Vec<ToolInput>,
    /// See [`StepInputs::relative_tolerance`].
    pub relative_tolerance: Option<f64>,
}

impl LoggedInputs {
    /// As a step takes them.
    #[must_use]
    pub fn as_inputs(&self) -> StepInputs<'_> {
        StepInputs { tools: &self.tools, relative_tolerance: self.relative_tolerance, ..StepInputs::default() }
    }
}

impl From<Vec<ToolInput>> for LoggedInputs {
    fn from(tools: Vec<ToolInput>) -> Self {
        Self { tools, relative_tolerance: None }
    }
}

/// What the tools and the governor did, step by step, since the scene was at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InputLog {
    /// `(step, motion)`, steps ascending; the step is the number of steps taken before it.
    motions: Vec<(u64, ToolInput)>,
    /// `(step, relative tolerance)`, likewise.
    tolerances: Vec<(u64, f64)>,
    /// Steps that the log covers.
    steps: u64,
    max_motions: usize,
    full: bool,
}

impl InputLog {
    /// An empty log for at most `max_motions` motions.
    #[must_use]
    pub fn new(max_motions: usize) -> Self {
        Self { max_motions, full: max_motions == 0, ..Self::default() }
    }

    /// Notes the inputs of one step. The log of a step is whole or absent: once its motions do not fit,
    /// the log ends with the step before.
    pub fn record(&mut self, inputs: &StepInputs<'_>) {
        self.full |= self.motions.len() + inputs.tools.len() > self.max_motions;
        if !self.full {
            self.motions.extend(inputs.tools.iter().map(|input| (self.steps, *input)));
            self.tolerances.extend(inputs.relative_tolerance.map(|tolerance| (self.steps, tolerance)));
            self.steps += 1;
        }
    }

    /// Starts over, as the scene does on a reset.
    pub fn clear(&mut self) {
        *self = Self::new(self.max_motions);
    }

    /// Steps that the log covers.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Memory that it takes, bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.motions.as_slice()) + size_of_val(self.tolerances.as_slice())
    }

    /// Whether the log ended before the session did.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.full
    }

    /// Motions in the order they were applied, with the step each was applied in.
    #[must_use]
    pub fn motions(&self) -> &[(u64, ToolInput)] {
        &self.motions
    }

    /// The inputs of each step that the log covers, in order.
    pub fn inputs(&self) -> impl Iterator<Item = LoggedInputs> {
        let (mut motions, mut tolerances) = (self.motions.as_slice(), self.tolerances.as_slice());
        (0..self.steps).map(move |step| LoggedInputs {
            tools: take_until(&mut motions, step).iter().map(|(_, input)| *input).collect(),
            relative_tolerance: take_until(&mut tolerances, step).last().map(|(_, tolerance)| *tolerance),
        })
    }

    /// A world that went through all that was recorded.
    ///
    /// # Errors
    /// The scene cannot be built; one that was recorded from can.
    pub fn replay(&self, scene: &Scene, workers: &Workers<'_>) -> Result<World, SceneError> {
        let mut world = World::new(scene)?;
        for inputs in self.inputs() {
            world.step(workers, &NoClock, &inputs.as_inputs());
        }
        Ok(world)
    }
}

/// Takes the entries up to a step from the front of a list.
fn take_until<'a, T>(entries: &mut &'a [(u64, T)], step: u64) -> &'a [(u64, T)] {
    let (now, later) = entries.split_at(entries.partition_point(|(at, _)| *at <= step));
    *entries = later;
    now
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::step_io::ToolMotion;

    const LIFT: ToolInput = ToolInput { tool: 0, motion: ToolMotion::Lift };

    #[test]
    fn a_full_log_ends_with_a_whole_step() {
        let mut log = InputLog::new(3);
        log.record(&StepInputs::of(&[LIFT, LIFT]));
        log.record(&StepInputs::of(&[]));
        log.record(&StepInputs::of(&[LIFT, LIFT]));
        log.record(&StepInputs::of(&[LIFT]));
        assert!(log.is_full());
        assert_eq!((log.steps(), log.motions().len()), (2, 2));
    }

    #[test]
    fn inputs_come_step_by_step_as_they_were_recorded() {
        let step = |tools: &[ToolInput], relative_tolerance| LoggedInputs { tools: tools.into(), relative_tolerance };
        let steps = [step(&[], None), step(&[LIFT, LIFT], Some(1e-2)), step(&[], None), step(&[LIFT], Some(1e-3))];
        let mut log = InputLog::new(10);
        steps.iter().for_each(|inputs| log.record(&inputs.as_inputs()));
        assert_eq!(log.inputs().collect::<Vec<_>>(), steps);
    }

    #[test]
    fn a_cleared_log_records_again() {
        let mut log = InputLog::new(1);
        log.record(&StepInputs::of(&[LIFT, LIFT]));
        log.clear();
        log.record(&StepInputs::of(&[LIFT]));
        assert_eq!((log.is_full(), log.steps()), (false, 1));
    }

    #[test]
    fn a_log_of_no_capacity_covers_nothing() {
        let mut log = InputLog::new(0);
        log.record(&StepInputs::of(&[]));
        assert_eq!((log.is_full(), log.steps()), (true, 0));
    }
}
