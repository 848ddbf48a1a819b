//! From a file to a configuration: what is wrong is told by the field, with what was probably meant.

use std::path::{Path, PathBuf};

use super::{DeviceKind, StationConfig};

/// A configuration that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// Something in it is not as it should be; one line a fault.
    #[error("{}", faults.join("\n"))]
    Invalid {
        /// Field and limit of each.
        faults: Vec<String>,
    },
}

impl StationConfig {
    /// Reads a file. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// The field and its limit.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|error| ConfigError::Read { path: path.into(), error })?;
        let mut config = Self::from_toml(&path.display().to_string(), &text)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let files = [config.server.ca_file.as_mut(), config.server.token_file.as_mut()];
        let recordings = config.devices.iter_mut().map(|device| match &mut device.kind {
            DeviceKind::Recorded(recorded) => Some(&mut recorded.file),
            DeviceKind::OpenHaptics(openhaptics) => openhaptics.library.as_mut(),
            _ => None,
        });
        for file in files.into_iter().chain(recordings).flatten() {
            *file = folder.join(&*file);
        }
        Ok(config)
    }

    /// Reads a text; `name` is what errors call it.
    ///
    /// # Errors
    /// The field and its limit.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, ConfigError> {
        let invalid = |faults: Vec<String>| ConfigError::Invalid {
            faults: faults.into_iter().map(|fault| format!("{name}: {fault}")).collect(),
        };
        let document = toml::Deserializer::parse(text).map_err(|error| invalid(vec![error.to_string()]))?;
        let config: Self = serde_path_to_error::deserialize(document).map_err(|error| {
            let message = error.inner().message();
            invalid(vec![format!("{}: {message}{}", error.path(), did_you_mean(message))])
        })?;
        let faults = config.faults();
        if faults.is_empty() { Ok(config) } else { Err(invalid(faults)) }
    }
}

/// `; did you mean ...?` where a message about an unknown name offers one that is much like it.
fn did_you_mean(message: &str) -> String {
    let mut names = message.split('`').skip(1).step_by(2);
    let Some(word) = names.next().filter(|_| message.starts_with("unknown")) else { return String::new() };
    let distances = names.map(|name| (strsim::damerau_levenshtein(word, name), name));
    // A third of the letters may be wrong, or the word is the beginning of the name.
    let is_like = |(distance, name): &(usize, &str)| {
        3 * distance <= name.len().max(3) || (word.len() >= 3 && name.starts_with(word))
    };
    distances.filter(is_like).min().map_or(String::new(), |(_, name)| format!("; did you mean `{name}`?"))
}
