//! Names of sessions.

use std::fmt;
use std::str::FromStr;

use crate::error::SessionError;

/// A session's id, unique while the server runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SessionId(pub(crate) u64);

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "session-{}", self.0)
    }
}

impl FromStr for SessionId {
    type Err = SessionError;

    fn from_str(text: &str) -> Result<Self, SessionError> {
        let number = text.strip_prefix("session-").and_then(|digits| digits.parse().ok());
        number.map(Self).ok_or_else(|| SessionError::NoSession { id: text.chars().take(64).collect() })
    }
}
