//! Why a message was refused.

/// Why a message was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReplicaError {
    /// A patch or a state came before any keyframe, or after the structure was dropped.
    #[error("no keyframe yet")]
    NoKeyframe,
    /// A patch does not start where the replica is, or leads nowhere.
    #[error("patch leads from version {from} to {to}, replica is at version {have}")]
    PatchOfOtherVersion {
        /// Version of the replica.
        have: u64,
        /// Version the patch applies to.
        from: u64,
        /// Version it leads to.
        to: u64,
    },
    /// A state belongs to another structure.
    #[error("state belongs to version {got}, replica is at version {have}")]
    StateOfOtherVersion {
        /// Version of the replica.
        have: u64,
        /// Version of the state.
        got: u64,
    },
    /// A state is differences to a reference that did not come.
    #[error("state refers to that of step {got}, which did not come")]
    NoReference {
        /// Step of the reference.
        got: u64,
    },
    /// The surface is not the server's.
    #[error("surface hash at version {topology_version} is {computed:016x}, server says {expected:016x}")]
    HashMismatch {
        /// Version reached.
        topology_version: u64,
        /// What the server says.
        expected: u64,
        /// What the replica has.
        computed: u64,
    },
    /// Fragments do not follow each other, or are no message together.
    #[error("fragments that do not make a message")]
    Fragments,
    /// A message speaks of more or fewer objects than there are.
    #[error("{message}.bodies: {got} entries, {expected} expected")]
    BodyCount {
        /// `patch` or `state`.
        message: &'static str,
        /// Objects of the keyframe.
        expected: usize,
        /// Objects of the message.
        got: usize,
    },
    /// A field of an object is not valid.
    #[error("{message}.bodies[{body}].{source}")]
    Field {
        /// `keyframe`, `patch` or `state`.
        message: &'static str,
        /// Index of the object.
        body: usize,
        /// The field and what is wrong with it.
        source: FieldError,
    },
}

impl ReplicaError {
    pub(crate) fn field(message: &'static str, body: usize, source: FieldError) -> Self {
        Self::Field { message, body, source }
    }

    /// Whether nothing but a keyframe helps: the structure is missing, or is not the server's.
    /// A state that is refused costs nothing but itself.
    #[must_use]
    pub fn needs_keyframe(&self) -> bool {
        match self {
            Self::NoKeyframe
            | Self::Fragments
            | Self::NoReference { .. }
            | Self::PatchOfOtherVersion { .. }
            | Self::HashMismatch { .. } => true,
            Self::StateOfOtherVersion { have, got } => got > have,
            Self::BodyCount { message, .. } | Self::Field { message, .. } => *message != "state",
        }
    }
}

/// A field of an object and what is wrong with it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: {problem}")]
pub struct FieldError {
    /// Name of the field in the `.proto` file.
    pub field: &'static str,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What is wrong with a field.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// An array has another length than the one it runs in parallel with says.
    #[error("{got} entries, {expected} expected")]
    Length {
        /// Entries expected.
        expected: usize,
        /// Entries that came.
        got: usize,
    },
    /// A number is infinite or not a number.
    #[error("entry {index} is not finite")]
    NotFinite {
        /// Where in the array.
        index: usize,
    },
    /// A length that is none.
    #[error("{got} is not above 0")]
    NotPositive {
        /// The length.
        got: f64,
    },
    /// Bytes that are no integers.
    #[error("no integers as the protocol writes them")]
    Malformed,
    /// Ids do not ascend.
    #[error("entry {index}, id {id}, is not above the one before it")]
    NotAscending {
        /// Where in the array.
        index: usize,
        /// The id.
        id: u32,
    },
    /// An id that refers to nothing.
    #[error("id {id} does not exist")]
    UnknownId {
        /// The id.
        id: u32,
    },
    /// A count that is not supported.
    #[error("{got} is outside {min}..={max}")]
    Range {
        /// Least value.
        min: u32,
        /// Largest value.
        max: u32,
        /// The value.
        got: u32,
    },
}
