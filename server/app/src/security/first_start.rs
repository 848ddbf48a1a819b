//! What a server that is given a folder makes in it at its first start: an operator's token, shown once, and a certificate
//! of its own.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair};
use time::{Duration, OffsetDateTime};

use super::roles::Role;
use super::tls::Files;
use super::tokens::{Token, Wanted, add, write_secretly};

/// How long a certificate holds that a server makes for itself. Stations that trust it would stop on the day after: so
/// long that the machine is gone before.
const CERTIFICATE_LIFE: Duration = Duration::days(3650);
/// The name of the first token.
const OPERATOR: &str = "operator";

/// Makes a certificate and its key, unless both are there.
///
/// # Errors
/// One is there without the other, or they cannot be written.
pub fn certificate(files: &Files, names: Vec<String>) -> Result<()> {
    let Files { certificate, key } = files;
    if certificate.exists() || key.exists() {
        let is_pair = certificate.exists() && key.exists();
        ensure!(is_pair, "{} and {}: one is there without the other", certificate.display(), key.display());
        return Ok(());
    }
    let mut params = CertificateParams::new(names).context("names")?;
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, "Kerf server");
    let now = OffsetDateTime::now_utc();
    // A client's clock may be behind.
    (params.not_before, params.not_after) = (now - Duration::days(1), now + CERTIFICATE_LIFE);
    let own_key = KeyPair::generate().context("a key")?;
    let own = params.self_signed(&own_key).context("a certificate")?;
    write_secretly(key, &own_key.serialize_pem())?;
    write_secretly(certificate, &own.pem())
}

/// Makes a file of tokens with one of an operator, unless it is there, and shows the token. `link` makes an address
/// of it that opens the viewer.
///
/// # Errors
/// The file cannot be written, or nobody is there to be shown the token.
pub fn token(file: &Path, link: impl FnOnce(&Token) -> String) -> Result<()> {
    if file.exists() {
        return Ok(());
    }
    let wanted = Wanted { name: OPERATOR.into(), role: Role::Operator, expires: None, session: None };
    let token = add(file, wanted)?;
    let shown = writeln!(
        std::io::stdout(),
        "An operator's token was made. It is shown this once:\n\n    {}\n\nThis link opens the viewer with it:\n\n    {}\n",
        token.reveal(),
        link(&token)
    );
    if let Err(error) = shown {
        std::fs::remove_file(file).with_context(|| file.display().to_string())?;
        return Err(error).context("standard output, on which the first token is shown");
    }
    Ok(())
}

/// Names that a certificate is made out to: those of the machine on itself, its own, the address that it listens on, and
/// those that it is told of.
pub fn own_names(listens: SocketAddr, names: &[String]) -> Vec<String> {
    let mut own: Vec<String> = ["localhost", "127.0.0.1", "::1"].map(String::from).into();
    // A machine without a name has none in its certificate.
    own.extend(std::fs::read_to_string("/proc/sys/kernel/hostname").ok().map(|name| name.trim().to_owned()));
    if !listens.ip().is_unspecified() {
        own.push(listens.ip().to_string());
    }
    own.extend(names.iter().cloned());
    own.sort();
    own.dedup();
    own
}
