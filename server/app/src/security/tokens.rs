//! Tokens: 256 random bits each, of which the server keeps the digest alone. Who reads its file can let nobody in.

use std::fmt;
use std::fs::File;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::SystemTime;

use anyhow::{Context, Result, anyhow, ensure};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use kerf_session::SessionId;
use ring::digest::{SHA256, digest};
use ring::rand::{SecureRandom, SystemRandom};
use serde::{Deserialize, Serialize};
use subtle::ConstantTimeEq;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::caller::Caller;
use super::roles::Role;

/// Random bytes of a token.
const BYTES: usize = 32;
/// Most tokens of a file: each is compared at each call, in some 10 ns.
const MAX_TOKENS: usize = 1024;
/// Longest name of a token, bytes.
const MAX_NAME_BYTES: usize = 64;

/// A token itself. It has no `Debug`: it is told to whom it is for, and otherwise nobody.
pub struct Token(String);

impl Token {
    /// One that nobody has.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn random() -> Result<Self> {
        let mut bytes = [0; BYTES];
        SystemRandom::new().fill(&mut bytes).map_err(|_| anyhow!("the system gives no random numbers"))?;
        Ok(Self(URL_SAFE_NO_PAD.encode(bytes)))
    }

    /// The text to be told.
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

/// A file of tokens.
#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct TokenFile {
    #[serde(default)]
    token: Vec<Entry>,
}

/// A token as the file has it.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Whose it is. No two tokens have the same.
    pub name: String,
    /// What it is good for.
    pub role: Role,
    /// Digest of the token, in hexadecimal digits.
    pub sha256: String,
    /// It is good for nothing from then on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expires: Option<toml::value::Datetime>,
    /// The one session that it is good for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub session: Option<String>,
}

/// The tokens that a server takes.
pub struct Tokens(Vec<Known>);

struct Known {
    digest: Digest,
    expires: Option<SystemTime>,
    caller: Caller,
}

impl Tokens {
    /// Those of a file.
    ///
    /// # Errors
    /// What is wrong with it, and where.
    pub fn read(path: &Path) -> Result<Self> {
        let TokenFile { token } = read(path)?;
        let known = token.iter().enumerate().map(|(index, entry)| {
            let at = || format!("{}: token[{index}]", path.display());
            known(entry).with_context(at)
        });
        Ok(Self(known.collect::<Result<_>>()?))
    }

    /// Whether there is a token of this name that has not expired.
    pub fn has(&self, name: &str) -> bool {
        self.0.iter().any(|known| known.caller.name() == Some(name) && known.is_fresh())
    }

    /// Whose a token is. How long it takes tells nothing of how near it was to one.
    pub fn whose(&self, presented: &Digest) -> Option<&Caller> {
        let mut found = None;
        for known in &self.0 {
            if bool::from(known.digest.ct_eq(presented)) {
                found = Some(known);
            }
        }
        found.filter(|known| known.is_fresh()).map(|known| &known.caller)
    }
}

impl Known {
    fn is_fresh(&self) -> bool {
        self.expires.is_none_or(|expires| SystemTime::now() < expires)
    }
}

impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} tokens", self.0.len())
    }
}

/// SHA-256 of a token: all that is kept of one.
pub type Digest = [u8; 32];

/// The digest of a token.
pub fn sha256(token: &[u8]) -> Digest {
    digest(&SHA256, token).as_ref().try_into().expect("SHA-256 has 32 bytes")
}

fn hex(digest: Digest) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &str) -> Option<Digest> {
    let digits = text.as_bytes().as_chunks::<2>().0;
    let byte = |pair: &[u8; 2]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let bytes = digits.iter().map(byte).collect::<Option<Vec<u8>>>()?;
    bytes.try_into().ok().filter(|_| text.len() == 64)
}

fn known(entry: &Entry) -> Result<Known> {
    let Entry { name, role, sha256, expires, session } = entry;
    let digest = unhex(sha256).context("sha256: must be 64 hexadecimal digits")?;
    let expires = expires.as_ref().map(moment).transpose()?;
    let id = |session: &String| session.parse::<SessionId>().map_err(|_| anyhow!("session = {session:?}: is no id"));
    let session = session.as_ref().map(id).transpose()?;
    Ok(Known { digest, expires, caller: Caller::of_token(name, *role, session) })
}

/// The moment that a date with time and zone tells.
fn moment(date: &toml::value::Datetime) -> Result<SystemTime> {
    let moment = OffsetDateTime::parse(&date.to_string(), &Rfc3339);
    Ok(moment
        .with_context(|| format!("expires = {date}: must have date, time and zone, as 2027-01-31T12:00:00Z"))?
        .into())
}

fn read(path: &Path) -> Result<TokenFile> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let file: TokenFile = toml::from_str(&text).with_context(|| path.display().to_string())?;
    check(&file.token).with_context(|| path.display().to_string())?;
    Ok(file)
}

fn check(tokens: &[Entry]) -> Result<()> {
    ensure!(tokens.len() <= MAX_TOKENS, "{} tokens, of {MAX_TOKENS} at most", tokens.len());
    for (index, Entry { name, .. }) in tokens.iter().enumerate() {
        let is_name = (1..=MAX_NAME_BYTES).contains(&name.len()) && !name.chars().any(char::is_control);
        ensure!(
            is_name,
            "token[{index}].name = {name:?}: must have 1 to {MAX_NAME_BYTES} bytes and no control characters"
        );
        let is_first = tokens[..index].iter().all(|other| other.name != *name);
        ensure!(is_first, "token[{index}].name = {name:?}: another token has it");
    }
    Ok(())
}

/// What is asked of a new token.
pub struct Wanted {
    /// Whose it is to be.
    pub name: String,
    /// What it is to be good for.
    pub role: Role,
    /// When it is to be good for nothing any more.
    pub expires: Option<SystemTime>,
    /// The one session that it is to be good for.
    pub session: Option<String>,
}

/// Makes a token and adds its digest to a file, which is made where there is none.
///
/// # Errors
/// The file makes no sense, has a token of this name, or cannot be written.
pub fn add(path: &Path, wanted: Wanted) -> Result<Token> {
    let mut file = if path.exists() { read(path)? } else { TokenFile::default() };
    let token = Token::random()?;
    let expires = wanted.expires.map(|expires| OffsetDateTime::from(expires).format(&Rfc3339)).transpose()?;
    let entry = Entry {
        name: wanted.name,
        role: wanted.role,
        sha256: hex(sha256(token.reveal().as_bytes())),
        expires: expires.map(|expires| expires.parse()).transpose().context("expires")?,
        session: wanted.session,
    };
    known(&entry)?;
    file.token.push(entry.clone());
    check(&file.token)?;
    // What somebody has written by hand stays as it is.
    let before = if path.exists() { std::fs::read_to_string(path)? } else { String::new() };
    let gap = if before.is_empty() { "" } else { "\n" };
    let added = toml::to_string(&TokenFile { token: vec![entry] })?;
    write_secretly(path, &format!("{before}{gap}{added}"))?;
    Ok(token)
}

/// Writes a file that its owner alone may read, aside first: whoever reads it finds all of the old one or of the new one.
///
/// # Errors
/// The system's.
pub fn write_secretly(path: &Path, text: &str) -> Result<()> {
    let aside = path.with_added_extension("new");
    let write = || {
        let mut file = File::options().write(true).create(true).truncate(true).mode(0o600).open(&aside)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&aside, path)
    };
    write().with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn of(token: &str) -> Digest {
        sha256(token.as_bytes())
    }

    fn wanted(name: &str, role: Role) -> Wanted {
        Wanted { name: name.into(), role, expires: None, session: None }
    }

    #[test]
    fn a_file_has_no_token_and_lets_in_who_has_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens.toml");
        std::fs::write(&path, "# The lab's.\n").unwrap();
        let [anna, ben] = ["anna", "ben"].map(|name| add(&path, wanted(name, Role::Driver)).unwrap());
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("# The lab's.\n") && !text.contains(anna.reveal()), "{text}");
        let tokens = Tokens::read(&path).unwrap();
        assert_eq!(tokens.whose(&of(anna.reveal())).unwrap().name(), Some("anna"));
        assert_eq!(tokens.whose(&of(ben.reveal())).unwrap().name(), Some("ben"));
        for stranger in [&anna.reveal()[1..], "", &format!("{}A", anna.reveal())] {
            assert!(tokens.whose(&of(stranger)).is_none(), "{stranger}");
        }
        assert!(add(&path, wanted("anna", Role::Viewer)).err().unwrap().to_string().contains("another token has it"));
    }

    #[test]
    fn a_token_that_has_expired_is_good_for_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens.toml");
        let [past, future] = [
            SystemTime::now() - Duration::from_secs(1), //
            SystemTime::now() + Duration::from_secs(100),
        ];
        let add = |name, expires| add(&path, Wanted { expires: Some(expires), ..wanted(name, Role::Viewer) }).unwrap();
        let [late, good] = [add("late", past), add("good", future)];
        let tokens = Tokens::read(&path).unwrap();
        assert!(tokens.whose(&of(late.reveal())).is_none());
        assert!(tokens.whose(&of(good.reveal())).is_some());
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens.toml");
        let digest = "0".repeat(64);
        let token = |rest: &str| format!("[[token]]\nname = \"a\"\nrole = \"viewer\"\n{rest}");
        for (text, named) in [
            (token("sha256 = \"00\""), "token[0]: sha256"),
            (token("sha256 = \"0\"\nsecret = 1"), "secret"),
            (token(&format!("sha256 = \"{digest}\"\nsession = \"7\"")), "session = \"7\""),
            (token(&format!("sha256 = \"{digest}\"\nexpires = 2027-01-31")), "expires = 2027-01-31"),
            ("[[token]]\nname = \"a\"\nrole = \"boss\"".into(), "boss"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = format!("{:#}", Tokens::read(&path).unwrap_err());
            assert!(error.contains(named) && error.contains("tokens.toml"), "{error}");
        }
    }
}
