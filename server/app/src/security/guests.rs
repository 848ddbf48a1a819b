//! Guests: viewers of one session that somebody with a token has handed a link to. They are known to this run of the
//! server alone, for a time, and as long as their host is.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use kerf_session::SessionId;

use super::caller::Caller;
use super::roles::Role;
use super::tokens::{Digest, Token, sha256};
use crate::config::SecurityConfig;
use crate::status::RequestError;

/// The guests of a server.
pub struct Guests {
    max: usize,
    stay: Duration,
    /// By the digests of their tokens. How long it takes to find one tells of the digest alone, from which no token follows.
    known: Mutex<HashMap<Digest, Guest>>,
}

#[derive(Clone)]
struct Guest {
    caller: Caller,
    /// The name of the token of whoever has invited it.
    host: String,
    until: Instant,
}

impl Guests {
    /// None yet.
    pub fn new(config: &SecurityConfig) -> Self {
        let stay = Duration::from_secs_f64(config.guest_stay_s);
        Self { max: config.max_guests, stay, known: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Digest, Guest>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A token for a viewer of this session, and how long it is good.
    pub fn invite(&self, host: &str, session: SessionId) -> Result<(Token, Duration), RequestError> {
        let token = Token::random().map_err(|_| RequestError::NoRandomNumbers)?;
        let mut known = self.lock();
        let now = Instant::now();
        known.retain(|_, guest| now < guest.until);
        if known.len() >= self.max {
            return Err(RequestError::TooManyGuests { limit: self.max });
        }
        let caller = Caller::of_token(&format!("a guest of {host}"), Role::Viewer, Some(session));
        let guest = Guest { caller, host: host.into(), until: now + self.stay };
        known.insert(sha256(token.reveal().as_bytes()), guest);
        Ok((token, self.stay))
    }

    /// Whose a token is, if its host is known still.
    pub fn whose(&self, token: &Digest, is_known: impl FnOnce(&str) -> bool) -> Option<Caller> {
        let guest = self.lock().get(token).cloned()?;
        (Instant::now() < guest.until && is_known(&guest.host)).then_some(guest.caller)
    }
}
