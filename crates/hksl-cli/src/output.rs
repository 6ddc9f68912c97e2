//! Output files and directories. Existing files are never overwritten.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::Value;

use crate::exit::Misuse;
use crate::standard::error_line;

/// Checks that an output file does not exist yet; `/dev/stdout` and other devices are allowed.
pub fn check_new(file: &Path) -> anyhow::Result<()> {
    if file.exists() && !is_a_device(file) {
        bail!("{} already exists; choose another file", file.display());
    }
    Ok(())
}

fn is_a_device(file: &Path) -> bool {
    ["/dev", "/proc"].iter().any(|folder| file.starts_with(folder))
}

/// Checks that an animation file ends in `.gif` and does not exist yet.
pub fn check_new_gif(file: &Path, option: &str) -> anyhow::Result<()> {
    let gif = file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gif"));
    if !gif && !is_a_device(file) {
        return Err(Misuse(format!(
            "{option} {}: animations are written as GIF only; choose a file name that ends in .gif, and convert \
             the file if you need another format",
            file.display()
        ))
        .into());
    }
    check_new(file)
}

/// Whether a file is this process's standard output under another name.
pub fn is_standard_output(file: &Path) -> bool {
    ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| file == Path::new(name))
}

/// Writes an output file. A closed pipe is not an error: its reader, such as `head`, has read all it needs.
pub fn write_file(file: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    match fs::write(file, bytes) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.with_context(|| format!("cannot write {}", file.display())),
    }
}

/// Prints a message about the files written; to standard error if one of them is standard output.
pub fn remark(out: &mut dyn Write, files: &[Option<&Path>], text: &str) -> std::io::Result<()> {
    if files.iter().flatten().any(|file| is_standard_output(file)) {
        error_line(text);
        return Ok(());
    }
    writeln!(out, "{text}")
}

/// A new output directory. It is created with its first file, so that a command that fails early leaves nothing behind.
pub struct Output {
    folder: PathBuf,
}

impl Output {
    /// The requested directory, which must be new or empty; by default the first of `name`, `name-2`, … that is free.
    pub fn new(asked: Option<&Path>, name: &str) -> anyhow::Result<Self> {
        let folder = match asked {
            Some(folder) => {
                let filled = folder.exists()
                    && fs::read_dir(folder)
                        .with_context(|| format!("cannot use {} as a folder", folder.display()))?
                        .next()
                        .is_some();
                if filled {
                    bail!(
                        "{} is not empty; choose a new or empty folder with --out",
                        folder.display()
                    );
                }
                let mut above = folder.ancestors().filter(|above| *above != Path::new(""));
                if let Some(file) =
                    above.find(|above| above.exists()).filter(|above| !above.is_dir())
                {
                    bail!(
                        "{} is a file, so {} cannot be created; choose another folder with --out",
                        file.display(),
                        folder.display()
                    );
                }
                folder.to_owned()
            }
            None => {
                let mut names = (1..).map(|number| match number {
                    1 => PathBuf::from(name),
                    number => PathBuf::from(format!("{name}-{number}")),
                });
                names.find(|folder| !folder.exists()).unwrap_or_else(|| name.into())
            }
        };
        Ok(Self { folder })
    }

    /// Path of the directory.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Path of a file in the directory; creates its parent directories.
    pub fn file(&self, name: &str) -> anyhow::Result<PathBuf> {
        let path = self.folder.join(name);
        let folder = path.parent().unwrap_or(&self.folder);
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        Ok(path)
    }

    /// Writes a file.
    pub fn bytes(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let path = self.file(name)?;
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Writes a text file.
    pub fn text(&self, name: &str, text: &str) -> anyhow::Result<()> {
        self.bytes(name, text.as_bytes())
    }

    /// Writes a JSON file.
    pub fn json(&self, name: &str, value: &Value) -> anyhow::Result<()> {
        self.text(name, &(serde_json::to_string_pretty(value)? + "\n"))
    }

    /// Writes a CSV file.
    pub fn csv(
        &self,
        name: &str,
        heading: &[&str],
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> anyhow::Result<()> {
        let path = self.file(name)?;
        let mut writer = csv::Writer::from_path(&path)
            .with_context(|| format!("cannot write {}", path.display()))?;
        writer.write_record(heading)?;
        for row in rows {
            writer.write_record(&row)?;
        }
        writer.flush().with_context(|| format!("cannot write {}", path.display()))
    }
}
