//! Metrics as text, read as Prometheus reads them.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use super::harness::soon;

/// The body of an answer over HTTP/1.1, and its head.
pub async fn get(address: SocketAddr, path: &str) -> (String, String) {
    let mut stream = TcpStream::connect(address).await.expect("a connection");
    let request = format!("GET {path} HTTP/1.0\r\nhost: {address}\r\nconnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.expect("a request is taken");
    let mut answer = Vec::new();
    soon("an answer", stream.read_to_end(&mut answer)).await.expect("a whole answer");
    let answer = String::from_utf8(answer).expect("text");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    (head.into(), body.into())
}

/// What is said of a metric.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Family {
    pub help: String,
    pub kind: String,
    /// Labels of its series, `le` not among them.
    pub labels: BTreeSet<String>,
}

/// A scrape.
#[derive(Debug, Default)]
pub struct Exposition {
    pub families: BTreeMap<String, Family>,
    /// By name and labels, as they were written.
    pub series: BTreeMap<String, f64>,
}

impl Exposition {
    pub async fn scrape(address: SocketAddr) -> Self {
        let (head, body) = get(address, "/metrics").await;
        assert!(head.starts_with("HTTP/1.") && head.contains(" 200 "), "{head}");
        assert!(head.to_lowercase().contains("content-type: text/plain; version=0.0.4"), "{head}");
        Self::parse(&body)
    }

    pub fn parse(text: &str) -> Self {
        let mut all = Self::default();
        for line in text.lines() {
            if let Some(comment) = line.strip_prefix("# ") {
                let (keyword, rest) = comment.split_once(' ').expect("a keyword");
                let (name, said) = rest.split_once(' ').expect("a name");
                let family = all.families.entry(name.into()).or_default();
                match keyword {
                    "HELP" => family.help = said.into(),
                    "TYPE" => family.kind = said.into(),
                    other => panic!("{other} is no keyword of the format"),
                }
                continue;
            }
            let (series, value) = line.rsplit_once(' ').expect("a value");
            let (name, labels) = series.split_once('{').unwrap_or((series, "}"));
            let owner = all.family_of(name).unwrap_or_else(|| panic!("{name} has neither help nor type"));
            let labels =
                labels.strip_suffix('}').expect("an end of labels").split("\",").filter(|label| !label.is_empty());
            let names = labels.map(|label| label.split_once("=\"").expect("a label").0.to_owned());
            let names: Vec<_> = names.filter(|name| name != "le").collect();
            all.families.get_mut(&owner).expect("a family").labels.extend(names);
            let value = value.parse().unwrap_or_else(|_| panic!("{line}: no number"));
            assert!(all.series.insert(series.into(), value).is_none(), "{series} twice");
        }
        all
    }

    /// The metric that a series of this name is of.
    pub fn family_of(&self, name: &str) -> Option<String> {
        let histogram = ["_bucket", "_sum", "_count"].iter().filter_map(|end| name.strip_suffix(end));
        let histogram = histogram.filter(|name| self.families.get(*name).is_some_and(|of| of.kind == "histogram"));
        let own = self.families.get(name).filter(|family| family.kind != "histogram").map(|_| name);
        own.into_iter().chain(histogram).next().map(str::to_owned)
    }

    /// The value of a series.
    pub fn value(&self, series: &str) -> f64 {
        *self.series.get(series).unwrap_or_else(|| panic!("{series} is not among {:#?}", self.series))
    }
}

/// Names of metrics in an expression of PromQL: what is neither a function, a keyword, a label nor a number.
pub fn metrics_in(expression: &str) -> BTreeSet<String> {
    const WORDS: [&str; 10] = ["by", "on", "and", "or", "unless", "without", "ignoring", "bool", "offset", "le"];
    let mut text = String::new();
    // Within braces stand labels, within brackets times.
    let mut depth = 0;
    for character in expression.chars() {
        match character {
            '{' | '[' => depth += 1,
            '}' | ']' => depth -= 1,
            _ if depth == 0 => text.push(character),
            _ => {}
        }
    }
    // After these stand labels in parentheses.
    for word in ["by", "on", "without", "ignoring"] {
        while let Some(start) = text.find(&format!(" {word} (")) {
            let end = text[start..].find(')').expect("an end of labels");
            text.replace_range(start..=start + end, " ");
        }
    }
    let is_part = |character: char| character.is_ascii_alphanumeric() || "_:".contains(character);
    let mut names = BTreeSet::new();
    let mut rest = text.as_str();
    while let Some(start) = rest.find(is_part) {
        let word = &rest[start..];
        let word = &word[..word.find(|character| !is_part(character)).unwrap_or(word.len())];
        rest = &rest[start + word.len()..];
        let is_function = rest.trim_start().starts_with('(');
        let is_number = word.starts_with(|character: char| character.is_ascii_digit());
        if !is_function && !is_number && !WORDS.contains(&word) {
            names.insert(word.to_owned());
        }
    }
    names
}

#[test]
fn metrics_are_found_in_expressions() {
    let found = |expression| metrics_in(expression).into_iter().collect::<Vec<_>>();
    let expression = "sum by (le, kind) (rate(a_total{kind=\"x\"}[5m])) / 0.5 > 2 and on (job) time() - b < 14 * 86400";
    assert_eq!(found(expression), ["a_total", "b"]);
    assert_eq!(found("histogram_quantile(0.99, sum by (le) (rate(c_bucket[5m])))"), ["c_bucket"]);
}
