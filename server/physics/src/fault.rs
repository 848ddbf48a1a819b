//! Roll-back: state that is not finite is caught at the end of a solve, taken back and reported.

/// What was found and undone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Step at which it was found.
    pub step: u64,
    /// Name of the object whose state was rolled back.
    pub object: String,
    /// What was not finite.
    pub what: FaultKind,
}

/// The quantity that was found not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// A node's velocity or position after the solve.
    NodeState,
    /// A wrench on a tool.
    ToolWrench,
}

impl std::fmt::Display for FaultKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NodeState => "the state of a node",
            Self::ToolWrench => "the force on a tool",
        })
    }
}
