//! How tools come into the scene: where they touch no tissue.

use kerf_physics::ToolInput;
use kerf_physics::step_io::ToolMotion;

use super::SessionCore;

impl SessionCore {
    /// Lets the coming step put down no tool in tissue. A blade that appears there has cut nothing on its way, and what a
    /// hand would feel of it has no cause in what the hand did: on an organ that was made anew, reset or taken back, after
    /// a jump, after a fault. It waits, lifted, until a pose of it is clear of tissue.
    pub(super) fn keep_tools_out_of_tissue(&mut self) {
        let Self { world, inbox, tools, waits, .. } = self;
        waits.fill(false);
        tools.inputs.retain_mut(|ToolInput { tool, motion }| {
            let ToolMotion::EnterAt { pose, opening } = *motion else { return true };
            if world.is_clear(*tool, &pose, opening) {
                return true;
            }
            waits[*tool] = true;
            inbox.keep_out(*tool, std::mem::take(&mut tools.jumped[*tool]));
            *motion = ToolMotion::Lift;
            world.tool_places().nth(*tool).flatten().is_some()
        });
    }
}
