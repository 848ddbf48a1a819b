//! The one door that every request goes through, whatever it speaks: the name that it calls the server by, the page that
//! it comes from, its token, and what its token is good for, by its path alone. What a session's own business is the
//! services judge, by the caller that is found out here.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::http::header::AUTHORIZATION;
use axum::middleware::Next;
use axum::response::Response;
use tonic::transport::server::TcpConnectInfo;

use super::caller::Caller;
use super::failures::Failures;
use super::guests::Guests;
use super::hosts::Hosts;
use super::reloaded::Reloaded;
use super::roles::{Need, need};
use super::tokens::Tokens;
use crate::incoming;
use crate::status::{RequestError, refusal};

/// How a token is sent, but for the case of the word.
const SCHEME: &str = "bearer ";

/// What a request is judged by.
pub struct Door {
    hosts: Hosts,
    /// `None`: none is asked for.
    tokens: Option<Arc<Reloaded<Tokens>>>,
    guests: Arc<Guests>,
    failures: Failures,
    max_failures: u32,
}

/// Hands on a request that may come in, with its caller.
pub async fn judge(State(door): State<Arc<Door>>, mut request: Request, next: Next) -> Response {
    match door.caller(&request) {
        Ok(caller) => {
            // Nobody behind the door has a use for it, so that nobody can tell it.
            request.headers_mut().remove(AUTHORIZATION);
            if let Some(caller) = caller {
                request.extensions_mut().insert(caller);
            }
            next.run(request).await
        }
        Err(error) => refusal(request.headers(), error),
    }
}

impl Door {
    /// Of a server of these names that takes these tokens and guests, and so many wrong tokens of a peer a minute.
    pub fn new(
        hosts: Hosts,
        tokens: Option<Arc<Reloaded<Tokens>>>,
        guests: Arc<Guests>,
        max_failures: u32,
    ) -> Arc<Self> {
        Arc::new(Self { hosts, tokens, guests, failures: Failures::new(max_failures), max_failures })
    }

    /// Who calls; `None`: nobody has to say.
    fn caller(&self, request: &Request) -> Result<Option<Caller>, RequestError> {
        self.hosts.judge(request.uri(), request.headers())?;
        let path = request.uri().path();
        let needed = need(request.method(), path).ok_or_else(|| RequestError::NoCall { path: path.into() })?;
        let Need::Role(needed) = needed else { return Ok(None) };
        let Some(tokens) = &self.tokens else { return Ok(Some(Caller::anybody())) };
        let sent = request.headers().get(AUTHORIZATION).ok_or(RequestError::TokenMissing)?.as_bytes();
        let (scheme, token) = sent.split_at_checked(SCHEME.len()).ok_or(RequestError::TokenMissing)?;
        if !scheme.eq_ignore_ascii_case(SCHEME.as_bytes()) {
            return Err(RequestError::TokenMissing);
        }
        let (known, token) = (tokens.get(), token.trim_ascii());
        let guest = || self.guests.whose(token, |host| known.has(host));
        let caller = known.whose(token).cloned().or_else(guest).ok_or_else(|| self.fail(peer(request)))?;
        match caller.role() >= needed {
            true => Ok(Some(caller)),
            false => Err(RequestError::Role {
                name: caller.name().unwrap_or_default().into(),
                role: caller.role().name(),
                path: path.into(),
                needed: needed.name(),
            }),
        }
    }

    fn fail(&self, peer: Option<IpAddr>) -> RequestError {
        match self.failures.count(peer, Instant::now()) {
            true => {
                tracing::warn!(?peer, "a token that is not known, or has expired");
                RequestError::TokenUnknown
            }
            false => RequestError::TooManyWrongTokens { limit: self.max_failures },
        }
    }
}

fn peer(request: &Request) -> Option<IpAddr> {
    let address = request.extensions().get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr)?;
    Some(incoming::host(address.ip()))
}
