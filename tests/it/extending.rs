//! The page on extending is right: its diffs apply to this checkout, and the result compiles.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use hksl_tests::book::root;

/// What the binary is built from.
const PARTS: [&str; 5] = ["Cargo.toml", "Cargo.lock", "configs", "crates", "tests"];

fn copy(from: &Path, to: &Path) {
    if from.is_symlink() {
        symlink(fs::read_link(from).unwrap(), to).unwrap();
    } else if from.is_dir() {
        fs::create_dir(to).unwrap();
        for entry in fs::read_dir(from).unwrap() {
            let entry = entry.unwrap();
            copy(&entry.path(), &to.join(entry.file_name()));
        }
    } else {
        fs::copy(from, to).unwrap();
    }
}

fn succeed(command: &mut Command) {
    let output = command.output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}\n{error}");
}

/// Dependencies are shared with this checkout's target directory, so that only hksl's own crates are checked.
#[test]
fn a_task_and_a_method_are_added_in_three_places_each() {
    let (root, folder) = (root(), tempfile::tempdir().unwrap());
    for part in PARTS {
        copy(&root.join(part), &folder.path().join(part));
    }
    // MuJoCo, for the build script.
    symlink(root.join(".native"), folder.path().join(".native")).unwrap();
    for name in ["task", "method"] {
        let diff = root.join(format!("docs/extending/{name}.diff"));
        let text = fs::read_to_string(&diff).unwrap();
        let places = text.lines().filter(|line| line.starts_with("+++ b/"));
        // A new source file and the line that declares it are one place.
        let places = places.filter(|line| !line.ends_with("/lib.rs")).count();
        assert_eq!(places, 3, "{}", diff.display());
        succeed(Command::new("git").arg("apply").arg(&diff).current_dir(folder.path()));
    }
    let mut check = Command::new(env!("CARGO"));
    check
        .args(["check", "--release", "--offline", "--package", "hksl-cli"])
        .current_dir(folder.path());
    succeed(check.env("CARGO_TARGET_DIR", root.join("target")));
}
