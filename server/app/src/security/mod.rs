//! Who gets in: TLS on the wire, tokens, what each is good for, and the one door that judges every request.
//!
//! Deliberately absent: accounts and passwords, which are for a proxy in front to ask for; tokens that say of themselves
//! what they are good for, which cannot be taken back; cookies, which a foreign page could use.

pub mod caller;
pub mod door;
mod expiry;
mod failures;
mod first_start;
pub mod guests;
mod hosts;
mod origins;
mod reloaded;
pub mod roles;
mod tls;
pub mod token_command;
mod tokens;
mod while_good;

use std::net::SocketAddr;
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::sign::CertifiedKey;
use tower_http::cors::CorsLayer;

use crate::config::{SecurityConfig, ServerConfig};
use door::Door;
use guests::Guests;
use hosts::Hosts;
use origins::Origins;
use reloaded::Reloaded;
use tls::Files;
use tokens::Tokens;

/// What keeps others out.
pub struct Security {
    /// What begins TLS on connections, and the certificate; `None`: they have none.
    tls: Option<(TlsAcceptor, Arc<Reloaded<CertifiedKey>>)>,
    /// `None`: none is asked for.
    tokens: Option<Arc<Reloaded<Tokens>>>,
    /// Whom links are handed to.
    pub guests: Arc<Guests>,
    names: Vec<String>,
    origins: Origins,
    max_wrong_tokens_per_minute: u32,
}

/// Refuses a server that others can reach, unless it has TLS and tokens, or is told to go without.
///
/// # Errors
/// What is missing, and what would help.
pub fn check(config: &ServerConfig) -> Result<()> {
    let listens = [("listen", Some(config.listen)), ("metrics_listen", config.metrics_listen)];
    listens.into_iter().try_for_each(|(field, listen)| listen.map_or(Ok(()), |listen| check_at(field, listen, config)))
}

fn check_at(field: &str, listen: SocketAddr, config: &ServerConfig) -> Result<()> {
    let security = &config.security;
    let missing = match (security.has_tls(), security.has_tokens()) {
        _ if listen.ip().to_canonical().is_loopback() => return Ok(()),
        (true, true) => return Ok(()),
        (false, false) => "neither TLS (security.certificate_file, security.key_file) nor tokens (security.token_file)",
        (false, true) => "no TLS (security.certificate_file, security.key_file)",
        (true, false) => "no tokens (security.token_file)",
    };
    if security.insecure {
        tracing::warn!(field, %listen, "security.insecure: others can reach this server, and it has {missing}");
        return Ok(());
    }
    bail!(
        "{field} = {listen}: others can reach it there, and this server has {missing}. One of these helps:\n  \
         --security-dir FOLDER  makes what is missing in it, and shows the first token once\n  \
         {flag}127.0.0.1:{port}  is reached from this machine alone\n  \
         --insecure  serves whoever comes, and whoever listens in on the way",
        flag = if field == "listen" { "--listen ".into() } else { format!("--set {field}=") },
        port = listen.port()
    )
}

impl Security {
    /// Reads what there is, and makes what is missing in `security.dir`. `listens` is where the server listens.
    ///
    /// # Errors
    /// What cannot be read or made.
    pub fn begin(config: &ServerConfig, listens: SocketAddr) -> Result<Self> {
        let ServerConfig { names, security, .. } = config;
        let origins = Origins::read(&security.allowed_origins)?;
        if let Some(folder) = &security.dir {
            let made = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder);
            made.with_context(|| format!("security.dir = {}", folder.display()))?;
        }
        let files = security.tls_files();
        if let (Some(files), true) = (&files, security.certificate_file.is_none()) {
            first_start::certificate(files, first_start::own_names(listens, names))?;
        }
        let tls = files.as_ref().map(tls::acceptor).transpose()?;
        let token_file = security.token_file();
        if let (Some(file), true) = (&token_file, security.token_file.is_none()) {
            let url = url(config, listens);
            first_start::token(file, |token| format!("{url}/#token={}", token.reveal()))?;
        }
        let tokens = token_file.map(|file| {
            let read = {
                let file = file.clone();
                move || Tokens::read(&file)
            };
            Reloaded::begin("the tokens", vec![file], read)
        });
        Ok(Self {
            tls,
            tokens: tokens.transpose()?,
            guests: Arc::new(Guests::new(security)),
            names: names.clone(),
            origins,
            max_wrong_tokens_per_minute: security.max_wrong_tokens_per_minute,
        })
    }

    /// What judges requests to this address.
    pub fn door(&self, listens: SocketAddr) -> Arc<Door> {
        let hosts = Hosts::new(listens.ip(), &self.names, &self.origins);
        Door::new(hosts, self.tokens.clone(), Arc::clone(&self.guests), self.max_wrong_tokens_per_minute)
    }

    /// What tells browsers which pages may call; `None`: those of this server alone.
    pub fn cors(&self) -> Option<CorsLayer> {
        self.origins.cors()
    }

    /// What begins TLS on connections; `None`: they have none.
    pub fn tls(&self) -> Option<TlsAcceptor> {
        self.tls.as_ref().map(|(acceptor, _)| acceptor.clone())
    }

    /// When the certificate stops being good, seconds since 1970.
    pub fn certificate_expires_s(&self) -> Option<i64> {
        let (_, certificate) = self.tls.as_ref()?;
        expiry::expires_s(certificate.get().cert.first()?)
    }
}

/// The address that a browser on this machine finds a server at; from elsewhere by the first of its names.
pub fn url(config: &ServerConfig, listens: SocketAddr) -> String {
    let scheme = if config.security.has_tls() { "https" } else { "http" };
    match listens.ip().is_unspecified() {
        false => format!("{scheme}://{listens}"),
        true => {
            let name = config.names.first().map_or("localhost", String::as_str);
            format!("{scheme}://{name}:{}", listens.port())
        }
    }
}

impl SecurityConfig {
    fn has_tls(&self) -> bool {
        self.dir.is_some() || self.certificate_file.is_some()
    }

    fn has_tokens(&self) -> bool {
        self.dir.is_some() || self.token_file.is_some()
    }

    fn token_file(&self) -> Option<PathBuf> {
        self.token_file.clone().or_else(|| Some(self.dir.as_ref()?.join("tokens.toml")))
    }

    /// Where `certificate_file` and `key_file` are given, which are given together, or in the folder.
    fn tls_files(&self) -> Option<Files> {
        let given = self.certificate_file.clone().zip(self.key_file.clone());
        let given = given.map(|(certificate, key)| Files { certificate, key });
        let made =
            |folder: &PathBuf| Files { certificate: folder.join("certificate.pem"), key: folder.join("key.pem") };
        given.or_else(|| self.dir.as_ref().map(made))
    }
}
