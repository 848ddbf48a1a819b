//! The stages of a step and the profile of what each one took.

use serde::{Deserialize, Serialize};

/// One stage of [`crate::World::step`], in the order of execution, and at the end of what showing it takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(usize)]
pub enum Stage {
    /// Tool poses at t + dt.
    ApplyInputs,
    /// Broad and narrow phase of tool-tissue contact.
    Contact,
    /// Broad and narrow phase of contact between tissue and tissue.
    SelfContact,
    /// The system matrix and the implicit velocity solve, contact active set included.
    Velocities,
    /// Contact models of the tools that somebody feels with: what the tissue behind their springs gives.
    ContactModel,
    /// New positions.
    Integrate,
    /// Element rotations and exact co-rotational forces at the new positions, roll-back of what is not finite, wrenches.
    Rotations,
    /// Fronts advance, links part.
    Fracture,
    /// Parts, nodes, matrices and preconditioner where links parted.
    Topology,
    /// Surface rebuilt where links parted.
    Surface,
    /// Surface adapted to the tools that touch it: only after steps that somebody sees
    /// ([`crate::World::adapt_surface`]).
    Adaptation,
}

impl Stage {
    /// Every stage, in the order of execution.
    pub const ALL: [Stage; 11] = [
        Stage::ApplyInputs,
        Stage::Contact,
        Stage::SelfContact,
        Stage::Velocities,
        Stage::ContactModel,
        Stage::Integrate,
        Stage::Rotations,
        Stage::Fracture,
        Stage::Topology,
        Stage::Surface,
        Stage::Adaptation,
    ];

    /// Name used as a column header and metric label.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Stage::ApplyInputs => "apply_inputs",
            Stage::Contact => "contact",
            Stage::SelfContact => "self_contact",
            Stage::Velocities => "velocities",
            Stage::ContactModel => "contact_model",
            Stage::Integrate => "integrate",
            Stage::Rotations => "rotations",
            Stage::Fracture => "fracture",
            Stage::Topology => "topology",
            Stage::Surface => "surface",
            Stage::Adaptation => "adaptation",
        }
    }
}

/// Where a step asks for the time; the core has no clock of its own.
pub trait StageClock: Sync {
    /// Nanoseconds since an arbitrary origin, monotonic.
    fn now_ns(&self) -> u64;
}

/// A clock that stands still, for runs that need no profile.
pub struct NoClock;

impl StageClock for NoClock {
    fn now_ns(&self) -> u64 {
        0
    }
}

/// Nanoseconds per stage of one step; `None` for a stage that did not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StepProfile {
    /// Indexed by `Stage as usize`.
    pub stage_ns: [Option<u64>; Stage::ALL.len()],
}

impl StepProfile {
    /// Sum over the stages that ran.
    #[must_use]
    pub fn total_ns(&self) -> u64 {
        self.stage_ns.iter().flatten().sum()
    }
}

/// Takes a lap at the end of each stage.
pub(crate) struct Lap<'a> {
    clock: &'a dyn StageClock,
    last_ns: u64,
    profile: StepProfile,
}

impl<'a> Lap<'a> {
    pub(crate) fn start(clock: &'a dyn StageClock) -> Self {
        Self { last_ns: clock.now_ns(), clock, profile: StepProfile::default() }
    }

    pub(crate) fn end(&mut self, stage: Stage) {
        let now = self.clock.now_ns();
        *self.profile.stage_ns[stage as usize].get_or_insert(0) += now.saturating_sub(self.last_ns);
        self.last_ns = now;
    }

    pub(crate) fn finish(self) -> StepProfile {
        self.profile
    }
}
