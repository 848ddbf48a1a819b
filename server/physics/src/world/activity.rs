//! Whether a body sleeps: [`super::sleep`].

use serde::{Deserialize, Serialize};

/// Whether steps are taken of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Activity {
    /// They are; so many of the last ones found and left it at rest.
    Awake { still_steps: u32 },
    /// They are not.
    Asleep,
}
