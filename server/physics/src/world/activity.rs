//! Whether a body sleeps: [`super::sleep`].

use crate::hash::StateHasher;

/// Whether steps are taken of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Activity {
    /// They are; so many of the last ones found and left it at rest.
    Awake { still_steps: u32 },
    /// They are not.
    Asleep,
}

impl Activity {
    /// Folds it into a hash; what moves leaves that as it is.
    pub(super) fn fold_into(self, hasher: &mut StateHasher) {
        match self {
            Self::Awake { still_steps: 0 } => {}
            Self::Awake { still_steps } => hasher.word(u64::from(still_steps)),
            Self::Asleep => hasher.word(u64::MAX),
        }
    }
}
