//! Event files, byte by byte.

use std::fs;
use std::path::{Path, PathBuf};

use hksl_train::Error;
use hksl_train::metrics::{EVENTS_NAME, EventFile, Value};

use super::golden::{GOLDEN, START, bytes, hex, write};

/// Writes all golden events; the file's length after each.
fn write_all(path: &Path) -> Vec<u64> {
    let mut events = EventFile::open(path, 0, START).unwrap();
    let mut ends = vec![events.length()];
    for index in 1..GOLDEN.len() {
        write(&mut events, index);
        ends.push(events.length());
    }
    events.sync().unwrap();
    ends
}

fn scratch() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tensorboard").join(EVENTS_NAME);
    (folder, path)
}

#[test]
fn events_are_those_of_the_tensorboard_package() {
    let (_folder, path) = scratch();
    let ends = write_all(&path);
    let file = fs::read(&path).unwrap();
    let mut start = 0;
    for ((name, expected), end) in GOLDEN.into_iter().zip(ends) {
        assert_eq!(hex(&file[start..end as usize]), expected, "{name}");
        start = end as usize;
    }
    assert_eq!(start, file.len());
}

#[test]
fn a_file_cut_after_any_event_goes_on_as_if_never_cut() {
    let (_folder, path) = scratch();
    let ends = write_all(&path);
    let whole = fs::read(&path).unwrap();
    for (last, &end) in ends.iter().enumerate() {
        // Behind the cut: whole events, half an event, nothing.
        for behind in [whole.len(), whole.len().min(end as usize + 7), end as usize] {
            fs::write(&path, &whole[..behind]).unwrap();
            let mut events = EventFile::open(&path, end, 5.0).unwrap();
            assert_eq!(events.length(), end);
            assert_eq!(fs::read(&path).unwrap(), whole[..end as usize]);
            (last + 1..GOLDEN.len()).for_each(|index| write(&mut events, index));
            assert_eq!(events.length(), whole.len() as u64);
            assert_eq!(fs::read(&path).unwrap(), whole);
        }
    }
}

#[test]
fn a_file_cut_after_any_event_takes_other_events() {
    let (_folder, path) = scratch();
    let ends = write_all(&path);
    let whole = fs::read(&path).unwrap();
    for &end in &ends {
        fs::write(&path, &whole).unwrap();
        let mut events = EventFile::open(&path, end, 5.0).unwrap();
        write(&mut events, 1);
        let expected = [&whole[..end as usize], &bytes(GOLDEN[1].1)].concat();
        assert_eq!(fs::read(&path).unwrap(), expected);
    }
}

#[test]
fn length_nought_starts_anew_whatever_the_file_holds() {
    let (_folder, path) = scratch();
    for before in [None, Some(&b""[..]), Some(&[7; 1000])] {
        if let Some(before) = before {
            fs::write(&path, before).unwrap();
        }
        let events = EventFile::open(&path, 0, START).unwrap();
        assert_eq!(hex(&fs::read(&path).unwrap()), GOLDEN[0].1);
        assert_eq!(events.length(), 40);
    }
}

#[test]
fn an_event_without_values_is_not_written() {
    let (_folder, path) = scratch();
    let mut events = EventFile::open(&path, 0, START).unwrap();
    let length = events.length();
    events.write(START, 1, std::iter::empty::<Value<'_>>()).unwrap();
    assert_eq!(events.length(), length);
    assert_eq!(fs::metadata(&path).unwrap().len(), length);
}

#[test]
fn a_cut_within_an_event_is_refused_and_changes_nothing() {
    let (_folder, path) = scratch();
    let ends = write_all(&path);
    let whole = fs::read(&path).unwrap();
    for length in (1..whole.len() as u64).filter(|length| !ends.contains(length)) {
        let error = EventFile::open(&path, length, START).unwrap_err();
        assert!(matches!(error, Error::Files(hksl_files::Error::Damaged { .. })), "{error}");
        assert!(error.to_string().contains(&format!("byte {length}, ")), "{error}");
    }
    assert_eq!(fs::read(&path).unwrap(), whole);
}

#[test]
fn a_missing_or_shorter_file_is_refused_with_its_name_and_both_lengths() {
    let (_folder, path) = scratch();
    let name = path.display().to_string();
    let error = EventFile::open(&path, 40, START).unwrap_err().to_string();
    for part in [&name, "0 bytes", "missing", "40"] {
        assert!(error.contains(part), "{error}");
    }
    assert!(!path.exists());

    drop(EventFile::open(&path, 0, START).unwrap());
    let error = EventFile::open(&path, 1000, START).unwrap_err().to_string();
    for part in [&name, "40 bytes", "1000"] {
        assert!(error.contains(part), "{error}");
    }
    assert_eq!(fs::metadata(&path).unwrap().len(), 40);
}

#[test]
fn a_file_of_another_program_is_refused_and_stays() {
    let (_folder, path) = scratch();
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, "a".repeat(100)).unwrap();
    let error = EventFile::open(&path, 60, START).unwrap_err();
    assert!(
        matches!(&error, Error::Files(hksl_files::Error::Damaged { path: named, .. }) if *named == path),
        "{error}"
    );
    assert_eq!(fs::metadata(&path).unwrap().len(), 100);
}

#[test]
fn a_path_that_cannot_be_written_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = EventFile::open(folder.path(), 0, START).unwrap_err();
    assert!(
        matches!(&error, Error::Files(hksl_files::Error::Write { path, .. }) if path == folder.path()),
        "{error}"
    );
    let error = EventFile::open(folder.path(), 1, START).unwrap_err();
    assert!(error.to_string().contains(&folder.path().display().to_string()), "{error}");
}
