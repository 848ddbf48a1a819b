//! Pages of other servers that may call this one, by their origins as browsers write them (RFC 6454, 6.2): exactly these,
//! because a pattern lets in pages that nobody thought of.

use std::time::Duration;

use anyhow::{Result, bail};
use axum::http::header::{AUTHORIZATION, CONTENT_TYPE, HeaderName};
use axum::http::{HeaderValue, Method, Uri};
use tower_http::cors::CorsLayer;

/// How long a browser may keep the answer to a preflight: the longest that browsers take. Origins change only with a
/// restart of the server, which asks again by refusing the call.
const PREFLIGHT_KEPT: Duration = Duration::from_secs(7200);

/// The origins of `security.allowed_origins`.
#[derive(Clone, Debug, Default)]
pub struct Origins(Vec<HeaderValue>);

impl Origins {
    /// Takes origins that browsers send.
    ///
    /// # Errors
    /// The first that none does, with what it sends instead where that can be told.
    pub fn read(texts: &[String]) -> Result<Self> {
        let judge = |text: &String| match serialized(text) {
            Some(sent) if sent == *text => Ok(HeaderValue::from_str(text)?),
            Some(sent) => bail!("security.allowed_origins: {text:?} is never sent by a browser; it sends {sent:?}"),
            None => {
                bail!("security.allowed_origins: {text:?} must be scheme://host or scheme://host:port, http or https")
            }
        };
        texts.iter().map(judge).collect::<Result<_>>().map(Self)
    }

    /// Whether pages of this origin may call.
    pub fn has(&self, origin: &HeaderValue) -> bool {
        self.0.contains(origin)
    }

    /// What tells browsers so; `None`: no origin is allowed, and browsers take silence for a no. Without credentials,
    /// which are cookies: a token is sent by the page itself.
    pub fn cors(&self) -> Option<CorsLayer> {
        // Those of gRPC-Web.
        let asked = ["x-grpc-web", "x-user-agent", "grpc-timeout"].map(HeaderName::from_static);
        let told = ["grpc-status", "grpc-message", "grpc-status-details-bin"].map(HeaderName::from_static);
        (!self.0.is_empty()).then(|| {
            CorsLayer::new()
                .allow_origin(self.0.clone())
                .allow_methods([Method::GET, Method::POST])
                .allow_headers([AUTHORIZATION, CONTENT_TYPE].into_iter().chain(asked).collect::<Vec<_>>())
                .expose_headers(told)
                .max_age(PREFLIGHT_KEPT)
        })
    }
}

/// An origin as browsers write it: in small letters, without the scheme's own port, and with nothing after it.
fn serialized(text: &str) -> Option<String> {
    let uri: Uri = text.parse().ok()?;
    let scheme = uri.scheme_str()?.to_ascii_lowercase();
    let own_port = match scheme.as_str() {
        "http" => 80,
        "https" => 443,
        _ => return None,
    };
    let host = uri.host().filter(|host| !host.is_empty())?.to_ascii_lowercase();
    Some(match uri.port_u16().filter(|port| *port != own_port) {
        Some(port) => format!("{scheme}://{host}:{port}"),
        None => format!("{scheme}://{host}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Origins> {
        Origins::read(&[text.into()])
    }

    #[test]
    fn origins_are_taken_as_browsers_write_them() {
        for text in ["https://lab.example", "http://lab.example:8080", "https://10.0.0.1:8443", "http://[::1]:5173"] {
            let origins = read(text).unwrap();
            assert!(origins.has(&HeaderValue::from_static(text)), "{text}");
            assert!(!origins.has(&HeaderValue::from_static("https://elsewhere.example")), "{text}");
        }
    }

    #[test]
    fn what_no_browser_sends_is_refused_with_what_it_sends() {
        for (text, sent) in [
            ("https://lab.example/", "https://lab.example"),
            ("https://lab.example/viewer?a=b", "https://lab.example"),
            ("HTTPS://Lab.Example", "https://lab.example"),
            ("https://lab.example:443", "https://lab.example"),
            ("http://lab.example:80", "http://lab.example"),
            ("https://anna@lab.example:8443", "https://lab.example:8443"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains("security.allowed_origins") && error.contains(&format!("{text:?}")), "{error}");
            assert!(error.ends_with(&format!("{sent:?}")), "{error}");
        }
    }

    #[test]
    fn what_is_no_origin_is_refused() {
        for text in
            ["*", "null", "", "lab.example", "lab.example:8443", "https://", "ftp://lab.example", "/", "https://a b"]
        {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(&format!("{text:?}")) && error.contains("scheme://host"), "{error}");
        }
    }
}
