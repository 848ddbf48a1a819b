//! How clients begin: the certificates that they trust to sign a server's, a token, and a session that is made for them.
//!
//! A token is read from a file or from the environment, and never stands on a command line, which every program of the
//! machine can read.

mod making;

use std::fmt;
use std::path::{Path, PathBuf};

use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use tonic::{Request, Status};

pub use making::make_session;

/// Holds the token itself, where no file does.
const ENV_TOKEN: &str = "KERF_TOKEN";

/// A connection that says the token, where there is one, with every call.
pub type Wire = InterceptedService<Channel, Token>;

/// What a client is let in with.
#[derive(Clone, Debug, Default, PartialEq, Eq, clap::Args)]
pub struct Access {
    /// Certificates (PEM) of those who are trusted to sign the server's. Default: the system's
    #[arg(long, env = "KERF_CA_FILE", value_name = "FILE", global = true)]
    pub ca_file: Option<PathBuf>,
    /// File with the token that the server asks for. Default: the variable KERF_TOKEN, or none
    #[arg(long, env = "KERF_TOKEN_FILE", value_name = "FILE", global = true)]
    pub token_file: Option<PathBuf>,
}

/// Why a client has nothing to be let in with.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// A file that cannot be read.
    #[error("{path}: {error}")]
    File {
        /// Which.
        path: PathBuf,
        /// The system's.
        error: std::io::Error,
    },
    /// Something that cannot be a token.
    #[error("{source_name}: holds no token")]
    Token {
        /// Where it was read.
        source_name: String,
    },
    /// No address.
    #[error("{server} is not an address")]
    Address {
        /// What was given.
        server: String,
    },
    /// The certificates are none, or the key is.
    #[error("certificates: {message}")]
    Certificates {
        /// What the transport says.
        message: String,
    },
}

impl Access {
    /// Where a server is, given as a URL or as host:port, to be connected to. `https` asks for TLS, and so does a
    /// file of certificates.
    ///
    /// # Errors
    /// It is no address, or the certificates cannot be read.
    pub fn endpoint(&self, server: &str) -> Result<Endpoint, AccessError> {
        let is_plain = server.starts_with("http://");
        let certificates = if is_plain { None } else { self.certificates()? };
        endpoint(server, certificates.as_deref(), None)
    }

    /// The certificates in its file, PEM.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn certificates(&self) -> Result<Option<String>, AccessError> {
        self.ca_file.as_deref().map(read).transpose()
    }

    /// The token.
    ///
    /// # Errors
    /// Its file cannot be read, or what is there cannot be one.
    pub fn token(&self) -> Result<Token, AccessError> {
        let (source_name, text) = match (&self.token_file, std::env::var(ENV_TOKEN)) {
            (Some(path), _) => (path.display().to_string(), read(path)?),
            (None, Ok(text)) => (ENV_TOKEN.to_owned(), text),
            (None, Err(_)) => return Ok(Token(None)),
        };
        let no_token = || AccessError::Token { source_name: source_name.clone() };
        if text.trim().is_empty() {
            return Err(no_token());
        }
        Token::of(text.trim()).ok_or_else(no_token)
    }
}

/// Where a server is, given as a URL or as host:port, to be connected to. `https` asks for TLS, and so do certificates (PEM) of
/// those who are trusted to sign the server's; without them those of the system are trusted. The server knows the client by
/// `identity`, where it asks for one.
///
/// # Errors
/// It is no address, or the certificates are none, or the key is.
pub fn endpoint(server: &str, certificates: Option<&str>, identity: Option<Identity>) -> Result<Endpoint, AccessError> {
    let scheme = if certificates.is_some() { "https" } else { "http" };
    let url = if server.contains("://") { server.to_owned() } else { format!("{scheme}://{server}") };
    let is_secure = url.starts_with("https://");
    let endpoint = Endpoint::from_shared(url).map_err(|_| AccessError::Address { server: server.into() })?;
    if !is_secure {
        return Ok(endpoint);
    }
    let tls = match certificates {
        None => ClientTlsConfig::new().with_native_roots(),
        Some(pem) => ClientTlsConfig::new().ca_certificate(Certificate::from_pem(pem)),
    };
    let tls = match identity {
        None => tls,
        Some(identity) => tls.identity(identity),
    };
    endpoint.tls_config(tls).map_err(|error| AccessError::Certificates { message: root_cause(&error) })
}

fn read(path: &Path) -> Result<String, AccessError> {
    std::fs::read_to_string(path).map_err(|error| AccessError::File { path: path.into(), error })
}

/// Says the token, where there is one, with every call.
#[derive(Clone)]
pub struct Token(Option<MetadataValue<Ascii>>);

impl Token {
    /// This one; `None` where it cannot be one.
    #[must_use]
    pub fn of(text: &str) -> Option<Self> {
        let mut value: MetadataValue<Ascii> = format!("Bearer {text}").parse().ok()?;
        // Not to be shown, nor to be kept by the compression of heads.
        value.set_sensitive(true);
        Some(Self(Some(value)))
    }

    /// None.
    #[must_use]
    pub fn none() -> Self {
        Self(None)
    }

    /// What it says, to be said elsewhere; `None`: nothing.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        self.0.as_ref()?.to_str().ok()?.strip_prefix("Bearer ")
    }

    /// A connection that says it.
    #[must_use]
    pub fn over(self, channel: Channel) -> Wire {
        InterceptedService::new(channel, self)
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "a token" } else { "no token" })
    }
}

impl Interceptor for Token {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = &self.0 {
            request.metadata_mut().insert("authorization", token.clone());
        }
        Ok(request)
    }
}

/// What an error comes from in the end: the transport's own words say nothing.
#[must_use]
pub fn root_cause(error: &dyn std::error::Error) -> String {
    std::iter::successors(Some(error), |error| error.source()).last().map_or_else(String::new, ToString::to_string)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_said_with_a_call_and_shown_to_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        std::fs::write(&file, "secret\n").unwrap();
        let mut token = Access { token_file: Some(file), ..Access::default() }.token().unwrap();
        let request = token.call(Request::new(())).unwrap();
        assert_eq!(request.metadata().get("authorization").unwrap(), "Bearer secret");
        assert!(!format!("{token:?} {request:?}").contains("secret"));
    }

    #[test]
    fn what_is_missing_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        let access = Access { ca_file: Some(file.clone()), token_file: Some(file.clone()) };
        assert!(access.token().unwrap_err().to_string().contains(&file.display().to_string()));
        assert!(access.endpoint("host:1").unwrap_err().to_string().contains(&file.display().to_string()));
        std::fs::write(&file, "\n").unwrap();
        assert!(access.token().unwrap_err().to_string().ends_with("holds no token"));
        assert!(Access::default().endpoint("not an address").is_err());
    }
}
