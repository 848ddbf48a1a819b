//! Whom a server answers: those who call it by its own name. A page of another site, or one whose name was made to mean
//! this machine (DNS rebinding), gets nothing.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use axum::http::header::{HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, Uri};

use super::origins::Origins;
use crate::status::RequestError;

/// The names that a server answers to.
pub struct Hosts {
    /// It is reached from its own machine alone, which has few names.
    is_loopback: bool,
    /// Others that it answers to then.
    names: Vec<String>,
    /// Whose pages may call it besides its own.
    origins: Origins,
}

impl Hosts {
    /// Of a server that listens there.
    pub fn new(listens: IpAddr, names: &[String], origins: &Origins) -> Self {
        let is_loopback = listens.to_canonical().is_loopback();
        Self { is_loopback, names: names.to_vec(), origins: origins.clone() }
    }

    /// Ends in an error unless a request names this server, and comes from no page, from one of its own, or from one of an
    /// allowed origin.
    pub fn judge(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), RequestError> {
        // HTTP/2 has it in the address, HTTP/1.1 in a header.
        let authority = uri.authority().map_or_else(|| text(headers.get(HOST)), |authority| authority.as_str());
        let host = without_port(authority);
        let is_named = || self.names.iter().any(|name| name.eq_ignore_ascii_case(host));
        // A page's own name can be made to mean any machine. An address cannot, and a name that is not asked for here.
        let is_ours = || is_loopback_name(host) || is_named() || !self.is_loopback && address(host).is_some();
        if (self.is_loopback || !self.names.is_empty()) && !is_ours() {
            return Err(RequestError::ForeignHost { host: host.into() });
        }
        let Some(origin) = headers.get(ORIGIN) else { return Ok(()) };
        if self.origins.has(origin) {
            return Ok(());
        }
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

fn address(host: &str) -> Option<IpAddr> {
    match host.strip_prefix('[').and_then(|host| host.strip_suffix(']')) {
        Some(host) => host.parse::<Ipv6Addr>().ok().map(IpAddr::from),
        None => host.parse::<Ipv4Addr>().ok().map(IpAddr::from),
    }
}

fn is_loopback_name(host: &str) -> bool {
    host.eq_ignore_ascii_case("localhost") || address(host).is_some_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_answered(listens: [u8; 4], host: &str, origin: Option<&str>) -> bool {
        is_answered_by(&["liver.example".into()], listens, host, origin)
    }

    fn is_answered_by(names: &[String], listens: [u8; 4], host: &str, origin: Option<&str>) -> bool {
        let headers = [(HOST, host)].into_iter().chain(origin.map(|origin| (ORIGIN, origin)));
        let headers = headers.map(|(name, value)| (name, HeaderValue::from_str(value).unwrap())).collect();
        let hosts = Hosts::new(listens.into(), names, &Origins::default());
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
            assert!(is_answered_by(&[], [0, 0, 0, 0], host, None), "{host}: reached from elsewhere it has any name");
        }
    }

    #[test]
    fn a_server_that_is_reached_from_elsewhere_and_knows_its_names_answers_to_those_and_to_addresses() {
        for host in ["liver.example:50051", "10.0.0.1:50051", "[fe80::1]:50051", "localhost"] {
            assert!(is_answered([0, 0, 0, 0], host, None), "{host}");
        }
        for host in ["", "rebound.example:50051", "127.0.0.1.nip.example"] {
            assert!(!is_answered([0, 0, 0, 0], host, None), "{host}");
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
