//! Event files, as the Python package `tensorboard` reads them.
//!
//! The Python of the environment variable `HKSL_PYTHON`, else `python3`, has to have the package
//! (`pip install tensorboard`); where it has not, these tests say so and do nothing.

use std::path::{Path, PathBuf};
use std::process::Command;

use hksl_train::metrics::{EVENTS_NAME, EventFile, Value};

use super::golden::{GOLDEN, MARKDOWN, START, hex, png, write};

/// A Python with the package.
fn python() -> Option<PathBuf> {
    let python = PathBuf::from(std::env::var_os("HKSL_PYTHON").unwrap_or("python3".into()));
    let found = Command::new(&python).args(["-c", "import tensorboard"]).output();
    if found.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    println!("skipped: {} has no package tensorboard; HKSL_PYTHON may name one", python.display());
    None
}

/// What a script in `fixtures` prints.
fn output(python: &Path, script: &str, argument: Option<&Path>) -> String {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tensorboard/fixtures");
    let output = Command::new(python).arg(fixtures.join(script)).args(argument).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{script}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_golden_records_are_what_the_package_writes() {
    let Some(python) = python() else { return };
    let printed = output(&python, "make_golden.py", None);
    let expected = GOLDEN.map(|(name, record)| format!("{name} {record}\n")).concat();
    assert_eq!(printed, expected);
}

#[test]
fn the_package_finds_what_was_written_across_a_resume() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(EVENTS_NAME);
    let scalar = |tag, value| Value::Scalar { tag, value };

    let mut events = EventFile::open(&path, 0, START).unwrap();
    (1..GOLDEN.len()).for_each(|index| write(&mut events, index));
    let saved = events.length();
    events.write(START + 1.0, 400, [scalar("episode/return", 9.0), scalar("lost", 9.0)]).unwrap();
    drop(events);
    let mut events = EventFile::open(&path, saved, START + 60.0).unwrap();
    let text = Value::Text { tag: "empty", markdown: "" };
    let infinite = [scalar("high", f64::INFINITY), scalar("overflow", 1e300), text];
    events.write(START + 61.0, 400, [scalar("episode/return", -2.5)]).unwrap();
    events.write(START + 62.0, 500, infinite).unwrap();
    drop(events);

    let time = |offset: f64| hex(&(START + offset).to_be_bytes());
    let single = |value: f32| hex(&value.to_be_bytes());
    let (nought, high) = (hex(&[0; 8]), single(f32::INFINITY));
    let (eval, steps) = (hex(&png()), 1_u64 << 40);
    let expected = [
        "version 2.0".to_owned(),
        format!("scalar episode/return 300 {} {}", time(0.25), single(0.1)),
        format!("scalar episode/return 400 {} {}", time(61.0), single(-2.5)),
        format!("scalar high 500 {} {high}", time(62.0)),
        format!("scalar low 0 {nought} {}", single(f32::NEG_INFINITY)),
        format!("scalar minus 0 {nought} {}", single(-0.0)),
        format!("scalar nan 0 {nought} {}", single(f32::NAN)),
        format!("scalar overflow 500 {} {high}", time(62.0)),
        format!("scalar zero 0 {nought} {}", single(0.0)),
        format!("text config -1 {} 7 0 {}", time(0.5), hex(MARKDOWN.as_bytes())),
        format!("text empty 500 {} 7 0 ", time(62.0)),
        format!("image frames/eval {steps} {} 2 1 {eval}", time(0.75)),
    ];
    let printed = output(&python, "read_back.py", Some(folder.path()));
    assert_eq!(printed.lines().collect::<Vec<_>>(), expected);
}
