//! Plain tables for the terminal.

use std::io::{self, Write};

/// Alignment of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    /// For text.
    Left,
    /// For numbers.
    Right,
}

/// Writes a heading and rows with two spaces between columns and no trailing blanks.
pub fn write(
    out: &mut dyn Write,
    columns: &[(&str, Align)],
    rows: &[Vec<String>],
) -> io::Result<()> {
    let width = |index: usize| {
        let cells = rows.iter().filter_map(|row| row.get(index)).map(|cell| cell.chars().count());
        cells.chain([columns[index].0.chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns.len()).map(width).collect();
    let heading = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
    for row in std::iter::once(&heading).chain(rows) {
        let cells =
            row.iter().zip(columns).zip(&widths).map(|((cell, (_, align)), &width)| match align {
                Align::Left => format!("{cell:<width$}"),
                Align::Right => format!("{cell:>width$}"),
            });
        let line = cells.collect::<Vec<_>>().join("  ");
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aligns_words_left_and_numbers_right() {
        let mut out = Vec::new();
        let columns = [("NAME", Align::Left), ("N", Align::Right), ("END", Align::Left)];
        let rows = [["a", "1", "x"], ["bcdef", "100", ""]]
            .map(|row| row.iter().map(|cell| (*cell).to_owned()).collect());
        write(&mut out, &columns, &rows).unwrap();
        let expected = "NAME     N  END\na        1  x\nbcdef  100\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
    }
}
