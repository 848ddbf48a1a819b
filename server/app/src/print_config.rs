//! `serve --print-config`: every setting with its value and what it is for, as a file that `--config` reads.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use serde_json::Value as Json;
use toml::{Table, Value};

use crate::config::ServerConfig;

/// Width of the remarks.
const COLUMNS: usize = 118;

/// The settings in force, each under its description.
///
/// # Errors
/// None that a test does not exclude.
pub fn text(config: &ServerConfig) -> Result<String> {
    let values = Table::try_from(config).context("settings as TOML")?;
    let schema = serde_json::to_value(schemars::schema_for!(ServerConfig))?;
    let mut text = String::new();
    table(&mut text, "", &values, &schema, &schema);
    Ok(text)
}

/// A table's own values, then the tables within it.
fn table(text: &mut String, path: &str, values: &Table, schema: &Json, root: &Json) {
    let Some(properties) = schema["properties"].as_object() else { return };
    let mut within = Vec::new();
    for (name, property) in properties {
        match values.get(name) {
            Some(Value::Table(inner)) => within.push((name, inner, property)),
            value => {
                remark(text, property["description"].as_str().unwrap_or_default());
                // What is not set has no value in TOML.
                let line = value.map_or(format!("# {name} ="), |value| format!("{name} = {value}"));
                writeln!(text, "{line}\n").expect("text grows");
            }
        }
    }
    for (name, inner, property) in within {
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        remark(text, property["description"].as_str().unwrap_or_default());
        writeln!(text, "[{path}]\n").expect("text grows");
        table(text, &path, inner, resolved(property, root), root);
    }
}

/// The schema that a property refers to.
fn resolved<'a>(property: &'a Json, root: &'a Json) -> &'a Json {
    let reference = property["$ref"].as_str().and_then(|reference| root.pointer(reference.trim_start_matches('#')));
    reference.unwrap_or(property)
}

/// A description as remarks of TOML.
fn remark(text: &mut String, description: &str) {
    let mut line = String::from("#");
    for word in description.split_whitespace() {
        if line.len() + 1 + word.len() > COLUMNS {
            writeln!(text, "{line}").expect("text grows");
            line = String::from("#");
        }
        line = line + " " + word;
    }
    writeln!(text, "{line}").expect("text grows");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_reads_back_and_describes_every_setting() {
        let mut config = ServerConfig { network_threads: 3, ..ServerConfig::default() };
        config.session.lease_s = 2.5;
        let text = text(&config).unwrap();
        assert_eq!(toml::from_str::<ServerConfig>(&text).unwrap(), config);
        let lines: Vec<&str> = text.lines().collect();
        for (i, line) in lines.iter().enumerate().filter(|(_, line)| line.contains(" =") && !line.starts_with("# ")) {
            assert!(lines[i - 1].starts_with("# "), "{line} is not described");
        }
        for expected in ["# record_dir =", "lease_s = 2.5", "[transport]"] {
            assert!(text.contains(expected), "{expected}");
        }
    }
}
