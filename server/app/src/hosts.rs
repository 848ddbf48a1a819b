//! Whom a server answers: those who call it by its own name. A page of another site, or one whose name was made to mean
//! this machine (DNS rebinding), gets nothing.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, Uri};
use axum::middleware::Next;
use axum::response::Response;

use crate::status::{RequestError, refusal};

/// The names that a server answers to.
pub struct Hosts {
    /// It is reached from its own machine alone, which has few names.
    is_loopback: bool,
    /// Others that it answers to then.
    names: Vec<String>,
}

/// Hands on a request that names this server, and comes from no page or from one of its own.
pub async fn check(State(hosts): State<Arc<Hosts>>, request: Request, next: Next) -> Response {
    match hosts.judge(request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(error) => refusal(request.headers(), error),
    }
}

impl Hosts {
    /// Of a server that listens there.
    pub fn new(listens: IpAddr, names: &[String]) -> Arc<Self> {
        Arc::new(Self { is_loopback: listens.to_canonical().is_loopback(), names: names.to_vec() })
    }

    fn judge(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), RequestError> {
        // HTTP/2 has it in the address, HTTP/1.1 in a header.
        let authority = uri.authority().map_or_else(|| text(headers.get(HOST)), |authority| authority.as_str());
        let host = without_port(authority);
        let is_ours = || is_loopback_name(host) || self.names.iter().any(|name| name.eq_ignore_ascii_case(host));
        if self.is_loopback && !is_ours() {
            return Err(RequestError::ForeignHost { host: host.into() });
        }
        let Some(origin) = headers.get(ORIGIN) else { return Ok(()) };
        let origin = text(Some(origin));
        match origin.split_once("://").is_some_and(|(_, site)| site.eq_ignore_ascii_case(authority)) {
            true => Ok(()),
            false => Err(RequestError::ForeignOrigin { origin: origin.into(), host: authority.into() }),
        }
    }
}

fn text(value: Option<&HeaderValue>) -> &str {
    value.and_then(|value| value.to_str().ok()).unwrap_or_default()
}

/// `[::1]:50051` and `[::1]` are of `[::1]`.
fn without_port(authority: &str) -> &str {
    match authority.rsplit_once(':') {
        Some((host, port)) if !port.contains(']') => host,
        _ => authority,
    }
}

fn is_loopback_name(host: &str) -> bool {
    let bracketed = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
    host.eq_ignore_ascii_case("localhost")
        || host.parse::<Ipv4Addr>().is_ok_and(|address| address.is_loopback())
        || bracketed.and_then(|host| host.parse::<Ipv6Addr>().ok()).is_some_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_answered(listens: [u8; 4], host: &str, origin: Option<&str>) -> bool {
        let headers = [(HOST, host)].into_iter().chain(origin.map(|origin| (ORIGIN, origin)));
        let headers = headers.map(|(name, value)| (name, HeaderValue::from_str(value).unwrap())).collect();
        let hosts = Hosts::new(listens.into(), &["liver.example".into()]);
        hosts.judge(&Uri::from_static("/"), &headers).is_ok()
    }

    #[test]
    fn a_server_on_loopback_answers_to_names_of_loopback_and_those_that_it_was_given() {
        for host in
            ["localhost:50051", "LOCALHOST", "127.0.0.1:9", "127.8.0.1", "[::1]:50051", "[::1]", "liver.example"]
        {
            assert!(is_answered([127, 0, 0, 1], host, None), "{host}");
        }
        for host in
            ["", "rebound.example:50051", "localhost.rebound.example", "10.0.0.1:50051", "127.0.0.1.nip.example"]
        {
            assert!(!is_answered([127, 0, 0, 1], host, None), "{host}");
            assert!(is_answered([0, 0, 0, 0], host, None), "{host}: reached from elsewhere it has any name");
        }
    }

    #[test]
    fn a_page_calls_the_server_that_it_came_from_and_no_other() {
        for listens in [[127, 0, 0, 1], [0, 0, 0, 0]] {
            for origin in ["http://localhost:5173", "https://LOCALHOST:5173"] {
                assert!(is_answered(listens, "localhost:5173", Some(origin)), "{origin}");
            }
            for origin in ["null", "", "http://localhost", "http://localhost:5174", "https://other.example"] {
                assert!(!is_answered(listens, "localhost:5173", Some(origin)), "{origin}");
            }
        }
    }
}
