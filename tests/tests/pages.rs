//! The pages: every relative link leads to a file, every anchor to a heading, and the book has every page.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use prost::Message;
use prost_types::FileDescriptorSet;

/// Names of the calls of the protocol.
fn calls() -> impl Iterator<Item = String> {
    let descriptors = FileDescriptorSet::decode(kerf_proto::FILE_DESCRIPTOR_SET).expect("descriptors");
    let services = descriptors.file.into_iter().flat_map(|file| file.service);
    services.flat_map(|service| service.method).map(|method| method.name().to_owned())
}

#[test]
fn the_page_of_the_protocol_names_each_call() {
    let page = fs::read_to_string(root().join("docs/reference/protocol.md")).expect("the page");
    let missing: Vec<String> = calls().filter(|name| !page.contains(&format!("`{name}`"))).collect();
    assert!(missing.is_empty() && calls().count() > 20, "{missing:?}");
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the project's folder")
}

/// Every Markdown file below a folder, but for what is built or installed.
fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        let name = entry.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if entry.is_dir() && !["target", "out", "node_modules", "dist", "book", ".git", ".venv"].contains(&name) {
            pages(&entry, found);
        } else if entry.extension().is_some_and(|ending| ending == "md") {
            found.push(entry);
        }
    }
}

/// A page without its blocks and lines of code, in which nothing is a link or a heading.
fn prose(text: &str) -> String {
    let mut is_code = false;
    let mut kept = String::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        } else if !is_code && !line.starts_with("    ") {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    kept
}

/// The targets of `[...](target)`.
fn links(prose: &str) -> impl Iterator<Item = &str> {
    prose.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target)
}

/// The anchors of a page's headings, as GitHub and mdBook make them.
fn anchors(prose: &str) -> BTreeSet<String> {
    let heading = |line: &str| Some(line.strip_prefix('#')?.trim_start_matches('#').trim().to_lowercase());
    let anchor = |heading: String| {
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    prose.lines().filter_map(heading).map(anchor).collect()
}

/// A path without its `..`.
fn plain(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut plain, part| {
        if part == Component::ParentDir {
            plain.pop();
        } else {
            plain.push(part);
        }
        plain
    })
}

/// What is wrong with a link of a page.
fn fault(root: &Path, page: &Path, target: &str) -> Option<String> {
    let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let folder = page.parent().expect("a page is in a folder");
    let path = if file.is_empty() { page.to_owned() } else { plain(&folder.join(file)) };
    let docs = root.join("docs");
    if !path.exists() {
        return Some("no such file".into());
    }
    if page.starts_with(&docs) && !path.starts_with(&docs) {
        return Some("a page of docs/ links within docs/: the book has nothing else".into());
    }
    let anchor = anchor?;
    let text = fs::read_to_string(&path).ok()?;
    (!anchors(&prose(&text)).contains(anchor)).then(|| "no such heading".into())
}

#[test]
fn every_link_of_every_page_leads_somewhere() {
    let root = root();
    let mut found = Vec::new();
    pages(&root, &mut found);
    // Parts of pages, which lie elsewhere once they are put together.
    found.retain(|page| !page.starts_with(root.join("tests/src")));
    assert!(found.len() > 20, "{found:?}");
    let mut faults = Vec::new();
    for page in &found {
        let text = prose(&fs::read_to_string(page).expect("a page"));
        for target in links(&text).filter(|target| !target.contains("://") && !target.starts_with("mailto:")) {
            if let Some(fault) = fault(&root, page, target) {
                faults.push(format!("{}: {target}: {fault}", page.strip_prefix(&root).unwrap_or(page).display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_book_has_every_page_of_docs() {
    let docs = root().join("docs");
    let summary = prose(&fs::read_to_string(docs.join("SUMMARY.md")).expect("the book's contents"));
    let listed: BTreeSet<PathBuf> = links(&summary).map(|target| plain(&docs.join(target))).collect();
    let mut found = Vec::new();
    pages(&docs, &mut found);
    let missing: Vec<_> =
        found.iter().filter(|page| !page.ends_with("SUMMARY.md") && !listed.contains(*page)).collect();
    assert!(missing.is_empty(), "not in SUMMARY.md: {missing:?}");
}

/// The whole numbers of a text, in order.
fn counts(text: &str) -> Vec<u32> {
    text.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

#[test]
fn the_readme_states_what_the_pages_that_programs_write_state() {
    let read = |path: &str| fs::read_to_string(root().join(path)).expect("a page");
    let page = |name: &str| read(&format!("docs/explanation/{name}.md"));
    let sentence = |page: &str, part: &str| -> String {
        let found = page.split(". ").find(|sentence| sentence.contains(part));
        found.unwrap_or_else(|| panic!("no sentence with `{part}`")).to_owned()
    };
    let verification = page("verification");
    let [kept, figures] = counts(&sentence(&verification, "figures that have a limit keep it"))[..] else {
        panic!("two counts")
    };
    let stability = page("stability");
    let [held, cases, refused] = counts(&sentence(&stability, "cases hold"))[..] else { panic!("three counts") };
    let rows: Vec<Vec<&str>> = verification
        .lines()
        .skip_while(|line| !line.starts_with("| material | cases |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    let cuts: u32 = rows.iter().map(|row| row[1].parse::<u32>().expect("a count")).sum();
    let range = |column: usize| {
        let ratios = rows.iter().flat_map(|row| row[column].split(" to ")).map(|r| r.parse::<f64>().expect("a ratio"));
        let (least, most) = ratios.fold((f64::MAX, f64::MIN), |(least, most), r| (least.min(r), most.max(r)));
        format!("{least:.2} to {most:.2}")
    };
    let expected = [
        format!("Of {figures} verified figures {} miss", figures - kept),
        format!("Of {cases} stability cases at the ends of the ranges {} fails", cases - held - refused),
        format!("the ratio is {} in {cuts} cases with {} materials", range(2), rows.len()),
        format!("With the blade at rest it is {}", range(3)),
    ];
    let readme = read("README.md");
    let missing: Vec<&String> = expected.iter().filter(|text| !readme.contains(&***text)).collect();
    assert!(missing.is_empty(), "README.md does not say: {missing:?}");
}

#[test]
fn a_link_that_leads_nowhere_is_seen() {
    let root = root();
    let page = root.join("docs/README.md");
    assert_eq!(fault(&root, &page, "none.md").as_deref(), Some("no such file"));
    assert_eq!(fault(&root, &page, "reference/scenes.md#none").as_deref(), Some("no such heading"));
    assert!(fault(&root, &page, "../README.md").is_some());
    assert_eq!(links("[a](b.md#c) and ![d](e.png)").collect::<Vec<_>>(), ["b.md#c", "e.png"]);
    assert_eq!(anchors("## `fixed`: what stands, 10 %?"), ["fixed-what-stands-10-".to_owned()].into());
}
