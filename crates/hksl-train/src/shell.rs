//! Words for a shell, in commands that people paste and scripts that run later.

use std::path::Path;

/// A word as a shell takes it back; with a line break or another control character, as bash, zsh and ksh do.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    if !word.chars().any(char::is_control) {
        return format!("'{}'", word.replace('\'', r"'\''"));
    }
    let escaped = word.chars().map(|c| match c {
        '\'' | '\\' => format!("\\{c}"),
        '\n' => r"\n".to_owned(),
        c if c.is_control() => format!("\\u{:04x}", u32::from(c)),
        c => c.to_string(),
    });
    format!("$'{}'", escaped.collect::<String>())
}

/// A path as an argument of a command; never taken for an option.
pub fn quoted_path(path: &Path) -> String {
    let text = path.to_string_lossy();
    let prefix = if text.starts_with('-') { "./" } else { "" };
    quoted(&format!("{prefix}{text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_from_a_shell() {
        for (word, expected) in [
            ("sac.batch_size=64", "sac.batch_size=64"),
            ("hksl.skips=[1, 3]", "'hksl.skips=[1, 3]'"),
            ("it's", r"'it'\''s'"),
            ("", "''"),
            ("two\nlines, it's", r"$'two\nlines, it\'s'"),
        ] {
            assert_eq!(quoted(word), expected);
        }
        assert_eq!(quoted_path(Path::new("-my runs")), "'./-my runs'");
    }
}
