//! TLS: the certificate that connections begin with, read again when its files change. HTTP/2 and, for browsers that fall
//! back to it, HTTP/1.1 are offered.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ring::digest::{SHA256, digest};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::{ClientHello, ResolvesServerCert};
use tokio_rustls::rustls::sign::CertifiedKey;

use super::reloaded::Reloaded;

/// Where a certificate and its key lie.
#[derive(Clone, Debug)]
pub struct Files {
    /// The certificate, and those that lead from it to one that clients trust.
    pub certificate: PathBuf,
    /// The key of the first.
    pub key: PathBuf,
}

/// What begins TLS on a connection, and the certificate that it begins with.
///
/// # Errors
/// The files cannot be read, or do not go together.
pub fn acceptor(files: &Files) -> Result<(TlsAcceptor, Arc<Reloaded<CertifiedKey>>)> {
    let read = {
        let files = files.clone();
        move || certified(&files)
    };
    let certificate = Reloaded::begin("the certificate", vec![files.certificate.clone(), files.key.clone()], read)?;
    tracing::info!(sha256 = fingerprint(&certificate.get()), "the certificate {}", files.certificate.display());
    let builder =
        ServerConfig::builder_with_provider(Arc::new(default_provider())).with_safe_default_protocol_versions();
    let mut config = builder?.with_no_client_auth().with_cert_resolver(Arc::new(Newest(Arc::clone(&certificate))));
    config.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
    Ok((Arc::new(config).into(), certificate))
}

fn certified(files: &Files) -> Result<CertifiedKey> {
    let Files { certificate, key } = files;
    let at = || certificate.display().to_string();
    let chain = CertificateDer::pem_file_iter(certificate).with_context(at)?;
    let chain = chain.collect::<Result<Vec<_>, _>>().with_context(at)?;
    ensure!(!chain.is_empty(), "{}: has no certificate (PEM)", at());
    let key_der = PrivateKeyDer::from_pem_file(key).with_context(|| key.display().to_string())?;
    // Fails where the key is another one's.
    let certified = CertifiedKey::from_der(chain, key_der, &default_provider());
    certified.with_context(|| format!("{} with {}", at(), key.display()))
}

/// As browsers show it.
pub fn fingerprint(certified: &CertifiedKey) -> String {
    let digest = certified.cert.first().map(|certificate| digest(&SHA256, certificate));
    let pairs = digest.iter().flat_map(AsRef::as_ref).map(|byte| format!("{byte:02X}"));
    pairs.collect::<Vec<_>>().join(":")
}

/// Hands out the certificate that was read last.
struct Newest(Arc<Reloaded<CertifiedKey>>);

impl fmt::Debug for Newest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the newest certificate")
    }
}

impl ResolvesServerCert for Newest {
    fn resolve(&self, _hello: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        Some(self.0.get())
    }
}
