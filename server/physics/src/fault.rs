//! Roll-back: state that is not finite, or that has energy from nowhere, is caught at the end of a solve, taken back and
//! reported.

use serde::{Deserialize, Serialize};

/// What was found and undone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Step at which it was found.
    pub step: u64,
    /// Name of the object whose state was rolled back.
    pub object: String,
    /// What was not as it can be.
    pub what: FaultKind,
}

/// The quantity that was found not finite, or out of all proportion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultKind {
    /// A node's velocity or position after the solve.
    NodeState,
    /// A wrench on a tool.
    ToolWrench,
    /// Energy of a piece: more than there was and than was worked.
    Energy,
}

impl std::fmt::Display for FaultKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NodeState => "the state of a node",
            Self::ToolWrench => "the force on a tool",
            Self::Energy => "the energy of a piece",
        })
    }
}
