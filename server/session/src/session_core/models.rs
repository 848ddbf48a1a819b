//! In which steps the models of contacts are brought up to date.

use kerf_physics::step_io::ToolOutput;

/// When the models of which tools fall due.
#[derive(Default)]
pub(super) struct ModelSchedule {
    /// By tool, ns.
    due_ns: Vec<u64>,
    tools: Vec<usize>,
}

impl ModelSchedule {
    /// Tools whose models fall due in the step that begins now: as often as they are wanted, and at once where there is
    /// none, so that a first touch does not wait. `outputs` are those of the step before.
    pub(super) fn due(&mut self, now_ns: u64, intervals_ns: &[Option<u64>], outputs: &[ToolOutput]) -> &[usize] {
        self.tools.clear();
        self.due_ns.resize(intervals_ns.len(), 0);
        for (tool, (interval_ns, output)) in intervals_ns.iter().zip(outputs).enumerate() {
            let (Some(interval_ns), due_ns) = (*interval_ns, &mut self.due_ns[tool]) else { continue };
            if output.contact.is_none() || now_ns >= *due_ns {
                // From the time it was due, so that the rate is kept though steps do not divide it; a first touch may come
                // before its time.
                *due_ns = (*due_ns + interval_ns).clamp(now_ns + interval_ns / 2, now_ns + interval_ns);
                self.tools.push(tool);
            }
        }
        &self.tools
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::step_io::ContactModel;

    const MS: u64 = 1_000_000;

    #[test]
    fn models_fall_due_as_often_as_they_are_wanted_and_at_a_first_touch() {
        let mut schedule = ModelSchedule::default();
        let touching = ToolOutput { contact: Some(ContactModel::default()), ..ToolOutput::default() };
        let mut due = |step: u64, output| schedule.due(step * MS, &[None, Some(4 * MS)], &[output, output]).to_vec();
        // A tool that touches nothing is asked each time, which costs nothing.
        assert!((0..1000).all(|step| due(step, ToolOutput::default()) == [1]));
        let times = (1000..2000).filter(|step| !due(*step, touching).is_empty()).count();
        assert!(times.abs_diff(250) <= 2, "{times} in a second");
    }
}
