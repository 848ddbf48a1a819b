//! The input log of a session: all that, with the scene, decides its bits.

use kerf_physics::{NoClock, Scene, SceneError, StepInputs, ToolInput, Workers, World};

/// What the tools did, step by step, since the scene was at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InputLog {
    /// `(step, motion)`, steps ascending; the step is the number of steps taken before it.
    motions: Vec<(u64, ToolInput)>,
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

    /// Notes the inputs of one step. The log of a step is whole or absent: once one does not fit,
    /// the log ends with the step before.
    pub fn record(&mut self, inputs: &[ToolInput]) {
        self.full |= self.motions.len() + inputs.len() > self.max_motions;
        if !self.full {
            self.motions.extend(inputs.iter().map(|input| (self.steps, *input)));
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
    pub fn inputs(&self) -> impl Iterator<Item = Vec<ToolInput>> {
        let mut rest = self.motions.as_slice();
        (0..self.steps).map(move |step| {
            let (now, later) = rest.split_at(rest.partition_point(|(at, _)| *at <= step));
            rest = later;
            now.iter().map(|(_, input)| *input).collect()
        })
    }

    /// A world that went through all that was recorded.
    ///
    /// # Errors
    /// The scene cannot be built; one that was recorded from can.
    pub fn replay(&self, scene: &Scene, workers: &Workers<'_>) -> Result<World, SceneError> {
        let mut world = World::new(scene)?;
        for tools in self.inputs() {
            world.step(workers, &NoClock, &StepInputs { tools: &tools });
        }
        Ok(world)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::step_io::ToolMotion;

    const LIFT: ToolInput = ToolInput { tool: 0, motion: ToolMotion::Lift };

    #[test]
    fn a_full_log_ends_with_a_whole_step() {
        let mut log = InputLog::new(3);
        log.record(&[LIFT, LIFT]);
        log.record(&[]);
        log.record(&[LIFT, LIFT]);
        log.record(&[LIFT]);
        assert!(log.is_full());
        assert_eq!((log.steps(), log.motions().len()), (2, 2));
    }

    #[test]
    fn inputs_come_step_by_step_as_they_were_recorded() {
        let steps: [&[ToolInput]; 4] = [&[], &[LIFT, LIFT], &[], &[LIFT]];
        let mut log = InputLog::new(10);
        steps.iter().for_each(|inputs| log.record(inputs));
        assert_eq!(log.inputs().collect::<Vec<_>>(), steps);
    }

    #[test]
    fn a_cleared_log_records_again() {
        let mut log = InputLog::new(1);
        log.record(&[LIFT, LIFT]);
        log.clear();
        log.record(&[LIFT]);
        assert_eq!((log.is_full(), log.steps()), (false, 1));
    }

    #[test]
    fn a_log_of_no_capacity_covers_nothing() {
        let mut log = InputLog::new(0);
        log.record(&[]);
        assert_eq!((log.is_full(), log.steps()), (true, 0));
    }
}
