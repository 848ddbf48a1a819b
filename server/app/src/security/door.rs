//! The one door that every request goes through, whatever it speaks: the name that it calls the server by, the page that
//! it comes from, its token, and what its token is good for, by its path alone. What a session's own business is the
//! services judge, by the caller that is found out here.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Instant;

use axum::body::Body;
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
use super::tokens::{Digest, Tokens, sha256};
use super::while_good::WhileGood;
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
    let Admitted { caller, token } = match door.admit(&request) {
        Ok(admitted) => admitted,
        Err(error) => return refusal(request.headers(), error),
    };
    // Nobody behind the door has a use for it, so that nobody can tell it.
    request.headers_mut().remove(AUTHORIZATION);
    if let Some(caller) = caller.clone() {
        request.extensions_mut().insert(caller);
    }
    let response = next.run(request).await;
    match token {
        None => response,
        Some(token) => response.map(|body| Body::new(WhileGood::new(body, move || door.whose(&token) == caller))),
    }
}

/// Who may come in.
struct Admitted {
    /// `None`: nobody has to say.
    caller: Option<Caller>,
    /// What of its token is kept.
    token: Option<Digest>,
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

    fn admit(&self, request: &Request) -> Result<Admitted, RequestError> {
        self.hosts.judge(request.uri(), request.headers())?;
        let path = request.uri().path();
        let needed = need(request.method(), path).ok_or_else(|| RequestError::NoCall { path: path.into() })?;
        let Need::Role(needed) = needed else { return Ok(Admitted { caller: None, token: None }) };
        if self.tokens.is_none() {
            return Ok(Admitted { caller: Some(Caller::anybody()), token: None });
        }
        let token = sha256(said(request).ok_or(RequestError::TokenMissing)?);
        let caller = self.whose(&token).ok_or_else(|| self.fail(peer(request)))?;
        match caller.role() >= needed {
            true => Ok(Admitted { caller: Some(caller), token: Some(token) }),
            false => Err(RequestError::Role {
                name: caller.name().unwrap_or_default().into(),
                role: caller.role().name(),
                path: path.into(),
                needed: needed.name(),
            }),
        }
    }

    /// Whose a token is at present.
    fn whose(&self, token: &Digest) -> Option<Caller> {
        let known = self.tokens.as_ref()?.get();
        let guest = || self.guests.whose(token, |host| known.has(host));
        known.whose(token).cloned().or_else(guest)
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

/// The token that a request says.
fn said(request: &Request) -> Option<&[u8]> {
    let (scheme, token) = request.headers().get(AUTHORIZATION)?.as_bytes().split_at_checked(SCHEME.len())?;
    scheme.eq_ignore_ascii_case(SCHEME.as_bytes()).then(|| token.trim_ascii())
}

fn peer(request: &Request) -> Option<IpAddr> {
    let address = request.extensions().get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr)?;
    Some(incoming::host(address.ip()))
}
