//! Names of sessions, and of the run of the server that they belong to.

use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::str::FromStr;

use crate::error::SessionError;

/// One run of a server: a number that no other run has, but for one chance in four billion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InstanceId(u32);

impl InstanceId {
    /// A new one. The operating system's random numbers are behind a hasher's keys.
    pub(crate) fn random() -> Self {
        Self(RandomState::new().hash_one(0) as u32)
    }
}

impl fmt::Display for InstanceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

/// A session's id, of no other session of this or any other run of the server. Ids ascend as sessions are created.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SessionId {
    /// The run of the server.
    pub(crate) instance: InstanceId,
    /// Counts its sessions.
    pub(crate) number: u64,
}

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "session-{}-{}", self.instance, self.number)
    }
}

impl FromStr for SessionId {
    type Err = SessionError;

    fn from_str(text: &str) -> Result<Self, SessionError> {
        let parse = || {
            let (instance, number) = text.strip_prefix("session-")?.split_once('-')?;
            let instance = InstanceId(u32::from_str_radix(instance, 16).ok()?);
            Some(Self { instance, number: number.parse().ok()? })
        };
        parse().ok_or_else(|| SessionError::NoSession { id: text.chars().take(64).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_reads_back_and_another_runs_is_another() {
        let ids = [InstanceId::random(), InstanceId::random()].map(|instance| SessionId { instance, number: 7 });
        assert_eq!(ids.map(|id| id.to_string().parse()), ids.map(Ok));
        assert_ne!(ids[0], ids[1]);
        assert!("session-7".parse::<SessionId>().is_err());
    }
}
