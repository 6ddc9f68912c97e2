//! What the tests look at in a page.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};

/// A page of Markdown.
#[derive(Debug, Clone)]
pub struct Page {
    /// Its file.
    pub path: PathBuf,
    /// Where links into it may lead.
    pub anchors: BTreeSet<String>,
    /// Where its links and pictures lead.
    pub links: Vec<String>,
    /// Its fenced blocks.
    pub blocks: Vec<Block>,
    /// What stands in backquotes within its text.
    pub code: Vec<String>,
}

/// A fenced block.
#[derive(Debug, Clone)]
pub struct Block {
    /// The word after the fence.
    pub language: String,
    /// What is in it.
    pub text: String,
    /// The line where it begins.
    pub line: usize,
}

impl Page {
    /// Reads it.
    ///
    /// # Panics
    /// If it cannot be read.
    pub fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path)
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self::parse(path, &text)
    }

    fn parse(path: &Path, text: &str) -> Self {
        let mut page = Self {
            path: path.to_owned(),
            anchors: BTreeSet::new(),
            links: Vec::new(),
            blocks: Vec::new(),
            code: Vec::new(),
        };
        let (mut heading, mut block): (Option<String>, Option<Block>) = (None, None);
        let options = Options::ENABLE_TABLES | Options::ENABLE_FOOTNOTES;
        for (event, range) in Parser::new_ext(text, options).into_offset_iter() {
            match event {
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    let name = anchor(&heading.take().unwrap_or_default());
                    let numbered = (1..).map(|number| format!("{name}-{number}"));
                    let mut names = std::iter::once(name.clone()).chain(numbered);
                    // As GitHub and mdbook tell headings of the same words apart.
                    names.find(|name| page.anchors.insert(name.clone()));
                }
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(language))) => {
                    let line = 1 + text[..range.start].matches('\n').count();
                    let language = language.into_string();
                    block = Some(Block { language, text: String::new(), line });
                }
                Event::End(TagEnd::CodeBlock) => page.blocks.extend(block.take()),
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    page.links.push(dest_url.into_string());
                }
                Event::Text(words) => {
                    if let Some(block) = &mut block {
                        block.text.push_str(&words);
                    } else if let Some(heading) = &mut heading {
                        heading.push_str(&words);
                    }
                }
                Event::Code(words) => {
                    if let Some(heading) = &mut heading {
                        heading.push_str(&words);
                    }
                    page.code.push(words.into_string());
                }
                _ => {}
            }
        }
        page
    }
}

/// The name under which a heading is linked to.
pub fn anchor(heading: &str) -> String {
    let letter = |c: char| match c {
        c if c.is_whitespace() => Some('-'),
        c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
        _ => None,
    };
    heading.trim().to_lowercase().chars().filter_map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_taken_apart() {
        let text = "# A `hksl` page, 1.0\n\n[there](b.md#c) and ![picture](c.svg)\n\n## Again\n\n## Again\n\n\
                    - item\n\n  ```sh\n  hksl tasks\n  ```\n";
        let page = Page::parse(Path::new("a.md"), text);
        let anchors: Vec<&str> = page.anchors.iter().map(String::as_str).collect();
        assert_eq!(anchors, ["a-hksl-page-10", "again", "again-1"]);
        assert_eq!(page.links, ["b.md#c", "c.svg"]);
        assert_eq!(page.code, ["hksl"]);
        let Block { language, text, line } = &page.blocks[0];
        assert_eq!((language.as_str(), text.as_str(), *line), ("sh", "hksl tasks\n", 11));
    }
}
