//! The book of `docs/`: which pages it has, how it is built, and how its commands are made small.

pub mod commands;
pub mod markdown;
pub mod shrink;

use std::path::{Path, PathBuf};

use mdbook_driver::MDBook;
use mdbook_driver::book::Book;
use mdbook_driver::errors::Error;
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};

use markdown::Page;

/// The checkout.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// The pages of the book, in the order of `docs/SUMMARY.md`.
///
/// # Panics
/// If a page cannot be read.
pub fn pages() -> Vec<Page> {
    let docs = root().join("docs");
    let links = Page::read(&docs.join("SUMMARY.md")).links;
    links.iter().map(|link| Page::read(&docs.join(link))).collect()
}

/// Builds it, as `book.toml` says, and returns where it is.
///
/// # Errors
/// Whatever mdbook reports.
pub fn build() -> Result<PathBuf, Error> {
    let mut book = MDBook::load(root())?;
    book.with_preprocessor(LinksOut);
    book.build()?;
    Ok(book.build_dir_for("html"))
}

/// Pages link to files of the checkout. From a built page they are elsewhere, as far up as the book lies deep.
struct LinksOut;

const OUT: &str = "](../";

impl Preprocessor for LinksOut {
    fn name(&self) -> &str {
        "links-out"
    }

    fn run(&self, context: &PreprocessorContext, mut book: Book) -> Result<Book, Error> {
        let up = "../".repeat(context.config.build.build_dir.components().count());
        book.for_each_chapter_mut(|chapter| {
            let mut parts = chapter.content.split(OUT);
            let mut content = parts.next().unwrap_or_default().to_owned();
            for part in parts {
                let (link, rest) = part.split_once(')').unwrap_or((part, ""));
                // mdbook would make a page of it, which only those of the book are.
                let link = link.replace(".md", "%2Emd");
                content.push_str(&format!("]({up}{link}){rest}"));
            }
            chapter.content = content;
        });
        Ok(book)
    }
}
