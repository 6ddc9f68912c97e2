//! CSV files that people bring, written by us, by pandas or by a spreadsheet: with a byte order mark, CRLF, blanks around
//! cells, semicolons or tabs between them, a nameless column of row numbers, columns of no concern, `1.0` for 1.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};

use csv::{ReaderBuilder, StringRecord, Trim};

use crate::numbers::{number, whole};
use crate::{Error, Result};

/// An open file, its header read.
#[derive(Debug)]
pub struct CsvTable<R> {
    path: PathBuf,
    reader: csv::Reader<R>,
    columns: Vec<String>,
    /// With semicolons between cells, commas stand within numbers.
    decimal_comma: bool,
}

impl CsvTable<BufReader<File>> {
    /// Opens a file.
    ///
    /// # Errors
    /// A file that cannot be read, or is not UTF-8.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|source| Error::read(path, source))?;
        Self::new(BufReader::new(file), path)
    }
}

impl<R: BufRead> CsvTable<R> {
    /// The same of any text; `path` serves the messages.
    ///
    /// # Errors
    /// As [`CsvTable::open`].
    pub fn new(mut text: R, path: &Path) -> Result<Self> {
        let delimiter = begin(&mut text).map_err(|source| Error::read(path, source))?;
        let mut builder = ReaderBuilder::new();
        let builder = builder.delimiter(delimiter).flexible(true).trim(Trim::All);
        let mut reader = builder.from_reader(text);
        let header = reader.headers().map_err(|error| Error::damaged(path, error))?;
        let columns = header.iter().map(str::to_owned).collect();
        Ok(Self { path: path.to_owned(), reader, columns, decimal_comma: delimiter == b';' })
    }

    /// The names of `names` that no column has.
    pub fn lacking(&self, names: &[&'static str]) -> Vec<&'static str> {
        names.iter().copied().filter(|name| self.position(name).is_none()).collect()
    }

    /// The columns that have a name, but none of these.
    pub fn others(&self, known: &[&str]) -> Vec<String> {
        let row_numbers = |name: &str| name.is_empty() || name.starts_with("Unnamed: ");
        let others = self.columns.iter().filter(|name| !known.contains(&name.as_str()));
        others.filter(|name| !row_numbers(name)).cloned().collect()
    }

    /// The next row; none after the last.
    ///
    /// # Errors
    /// Text that is not UTF-8, a file that cannot be read further.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>> {
        let mut cells = StringRecord::new();
        let more = self.reader.read_record(&mut cells);
        let more = more.map_err(|error| Error::damaged(&self.path, error))?;
        let line = cells.position().map_or(0, csv::Position::line);
        let (path, columns, decimal_comma) = (&self.path, &self.columns, self.decimal_comma);
        Ok(more.then_some(Row { path, columns, decimal_comma, cells, line }))
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column == name)
    }
}

/// Skips the byte order mark and returns what stands between the cells of the first line.
fn begin(text: &mut impl BufRead) -> io::Result<u8> {
    if text.fill_buf()?.starts_with("\u{feff}".as_bytes()) {
        text.consume("\u{feff}".len());
    }
    let start = text.fill_buf()?;
    let line = start.split(|byte| b"\r\n".contains(byte)).next().unwrap_or_default();
    let between = [b',', b';', b'\t'].into_iter().find(|delimiter| line.contains(delimiter));
    Ok(between.unwrap_or(b','))
}

/// A row of a file.
#[derive(Debug)]
pub struct Row<'a> {
    path: &'a Path,
    columns: &'a [String],
    decimal_comma: bool,
    cells: StringRecord,
    line: u64,
}

impl Row<'_> {
    /// A cell; none where there is no such column, or nothing in it.
    pub fn some(&self, column: &str) -> Option<&str> {
        let index = self.columns.iter().position(|name| name == column)?;
        self.cells.get(index).filter(|cell| !cell.is_empty())
    }

    /// A cell that must be there.
    pub fn text(&self, column: &str) -> Result<&str> {
        self.some(column).ok_or_else(|| self.damaged(&format!("{column} is missing")))
    }

    /// A whole number of at least 0, which may be written `1.0`.
    pub fn whole(&self, column: &str) -> Result<u64> {
        let cell = self.text(column)?;
        let number = whole(cell).and_then(|number| u64::try_from(number).ok());
        number.ok_or_else(|| {
            self.damaged(&format!("{column} is {cell:?}; it must be a whole number of at least 0"))
        })
    }

    /// A number, finite or not.
    pub fn number(&self, column: &str) -> Result<f64> {
        let cell = self.text(column)?;
        let with_point = self.decimal_comma.then(|| cell.replace(',', "."));
        let cell = with_point.as_deref().unwrap_or(cell);
        let number = cell.parse().ok().or_else(|| number(cell));
        number.ok_or_else(|| self.damaged(&format!("{column} is {cell:?}; it must be a number")))
    }

    fn damaged(&self, reason: &str) -> Error {
        Error::damaged(self.path, format!("line {}: {reason}", self.line))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<(u64, f64)> {
        let mut table = CsvTable::new(text.as_bytes(), Path::new("a.csv")).unwrap();
        assert_eq!(table.lacking(&["seed", "score"]), Vec::<&str>::new(), "{text}");
        let mut rows = Vec::new();
        while let Some(row) = table.next_row().unwrap() {
            rows.push((row.whole("seed").unwrap(), row.number("score").unwrap()));
        }
        rows
    }

    #[test]
    fn however_a_table_is_written_it_is_the_same() {
        for text in [
            "seed,score\n1,0.5\n2,10\n",
            "\u{feff}seed,score\r\n1,0.5\r\n2,10\r\n",
            "seed, score\n1, 0.5\n2, 10\n",
            ",seed,score\n0,1,0.5\n1,2,10\n",
            "Unnamed: 0,score,seed\n0,.5,1.0\n1,1e1,2.0\n",
            "seed;score\n1;0,5\n2;10,0\n",
            "seed\tscore\n1\t0.5\n2\t10\n",
            "\u{feff}\"seed\",\"note\",\"score\"\n\"1\",\"a, b\",\"0.5\"\n2,,10",
            "seed,score,\n1,0.5,\n2,10\n",
        ] {
            assert_eq!(read(text), [(1, 0.5), (2, 10.0)], "{text:?}");
        }
    }

    #[test]
    fn a_cell_that_does_not_fit_is_named() {
        let text = "seed,score\n1,0.5\n1.5,\n".as_bytes();
        let mut table = CsvTable::new(text, Path::new("a.csv")).unwrap();
        table.next_row().unwrap();
        let row = table.next_row().unwrap().unwrap();
        for (message, words) in [
            (row.whole("seed").unwrap_err(), "a.csv is damaged"),
            (row.whole("seed").unwrap_err(), "line 3: seed is \"1.5\"; it must be a whole number"),
            (row.number("score").unwrap_err(), "line 3: score is missing"),
        ] {
            assert!(message.to_string().contains(words), "{message}");
        }
    }
}
