//! The book is built, and every link of the documentation leads somewhere.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use hksl_tests::book::markdown::Page;
use hksl_tests::book::{build, pages, root};

/// The files of a folder that end so.
fn files(folder: &Path, extension: &str) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.extension().is_some_and(|own| own == extension)).collect()
}

/// Every page for people.
fn documents() -> Vec<Page> {
    let root = root();
    let mut paths = vec![root.join("docs/SUMMARY.md")];
    paths.extend(["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(|name| root.join(name)));
    for folder in ["results", "crates"] {
        let entries = fs::read_dir(root.join(folder)).unwrap();
        let readmes = entries.map(|entry| entry.unwrap().path().join("README.md"));
        paths.extend(readmes.filter(|path| path.is_file()));
    }
    pages().into_iter().chain(paths.iter().map(|path| Page::read(path))).collect()
}

fn is_elsewhere(link: &str) -> bool {
    let scheme = link.split_once(':').map(|(scheme, _)| scheme);
    scheme.is_some_and(|scheme| scheme.chars().all(|c| c.is_ascii_alphanumeric()))
}

#[test]
fn every_page_is_in_the_summary_once() {
    let listed: Vec<PathBuf> = pages().into_iter().map(|page| page.path).collect();
    let mut there = files(&root().join("docs"), "md");
    there.remove(&root().join("docs/SUMMARY.md"));
    assert_eq!(listed.len(), there.len(), "{listed:?}");
    assert_eq!(listed.into_iter().collect::<BTreeSet<_>>(), there);
}

#[test]
fn links_between_documents_lead_somewhere() {
    let (mut wrong, mut followed) = (Vec::new(), 0);
    for page in documents() {
        for link in page.links.iter().filter(|link| !is_elsewhere(link)) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = match path {
                "" => page.path.clone(),
                path => page.path.parent().unwrap().join(path),
            };
            let found = match anchor {
                "" => target.exists(),
                anchor => target.is_file() && Page::read(&target).anchors.contains(anchor),
            };
            followed += 1;
            if !found {
                wrong.push(format!("{}: {link}", page.path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "these lead nowhere:\n{}", wrong.join("\n"));
    assert!(followed > 50, "only {followed} links were found");
}

/// Nothing outside is asked for: a test must not depend on other people's machines.
#[test]
fn links_to_elsewhere_are_well_formed() {
    for page in documents() {
        for link in page.links.iter().filter(|link| is_elsewhere(link)) {
            let rest = link.strip_prefix("https://");
            let host = rest.and_then(|rest| rest.split('/').next()).unwrap_or_default();
            let fine = host.contains('.') && !link.contains(char::is_whitespace);
            assert!(fine, "{}: {link}", page.path.display());
        }
    }
}

#[test]
fn the_book_is_built_and_all_in_it_is_there() {
    let folder = build().unwrap();
    let built = files(&folder, "html");
    for page in pages() {
        let name = page.path.file_stem().unwrap();
        assert!(built.contains(&folder.join(name).with_extension("html")), "no page {name:?}");
    }
    let (mut wrong, mut followed) = (BTreeSet::new(), 0);
    for page in &built {
        let text = fs::read_to_string(page).unwrap();
        assert!(!text.contains("{{#"), "{}: a file is not included", page.display());
        for link in ["href", "src"].into_iter().flat_map(|name| attributes(&text, name)) {
            if is_elsewhere(link) || link.is_empty() {
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = match path {
                "" => page.clone(),
                // What links-out did to it, and browsers undo.
                path => folder.join(path.replace("%2Emd", ".md")),
            };
            // Headings of documents outside the book are the other test's.
            let is_page = target.extension().is_some_and(|extension| extension == "html");
            let has = |anchor| {
                let text = fs::read_to_string(&target).unwrap();
                attributes(&text, "id").any(|id| id == anchor)
            };
            followed += 1;
            if !target.exists() || is_page && !anchor.is_empty() && !has(anchor) {
                wrong.insert(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "these lead nowhere: {wrong:#?}");
    assert!(followed > 100, "only {followed} links were found");
}

/// The values of an attribute in a text of HTML.
fn attributes<'a>(text: &'a str, name: &str) -> impl Iterator<Item = &'a str> {
    let start = format!(" {name}=\"");
    let values: Vec<&str> =
        text.split(&start).skip(1).filter_map(|rest| rest.split('"').next()).collect();
    values.into_iter()
}
