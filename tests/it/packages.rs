//! The crates' packages contain what a user of each needs, and a project outside the workspace trains with one of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use hksl_tests::binary;
use hksl_tests::book::root;
use toml::Table;

/// The libraries and the program, in the order of their dependencies.
const CRATES: [&str; 9] = [
    "hksl-core",
    "hksl-files",
    "hksl-envs",
    "hksl-sac",
    "hksl-baselines",
    "hksl-probe",
    "hksl-report",
    "hksl-train",
    "hksl-cli",
];
/// crates.io's limit is 10 MB; the packages are far smaller without reference files.
const LARGEST_PACKAGE: u64 = 300_000;

/// Runs cargo, without a network, in the target directory that the tests were built in.
///
/// # Panics
/// If it fails.
fn cargo(folder: &Path, target: &Path, arguments: &[&str]) -> String {
    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    let output = Command::new(cargo)
        .args(arguments)
        .args(["--offline", "--target-dir"])
        .arg(target)
        .current_dir(folder)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo {}: {errors}", arguments.join(" "));
    String::from_utf8(output.stdout).unwrap()
}

/// The profile's folder, such as `target/release`.
fn profile() -> PathBuf {
    binary().parent().unwrap().to_owned()
}

/// The `Cargo.toml` of a folder.
fn manifest(folder: &Path) -> Table {
    fs::read_to_string(folder.join("Cargo.toml")).unwrap().parse().unwrap()
}

/// Unpacks a package into a folder and returns the names of its files.
fn unpack(package: &Path, folder: &Path) -> Vec<String> {
    let _ = fs::remove_dir_all(folder);
    fs::create_dir_all(folder).unwrap();
    let output = Command::new("tar")
        .args(["--extract", "--gzip", "--verbose", "--strip-components=1", "--file"])
        .arg(package)
        .arg("--directory")
        .arg(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn every_crate_is_packaged_and_a_project_outside_trains_with_hksl_core() {
    let target = profile().parent().unwrap().to_owned();
    let folder = target.join("outside");
    let packages = folder.join("packages");
    // Verification would build every crate once more.
    let arguments =
        ["package", "--workspace", "--exclude", "hksl-tests", "--no-verify", "--allow-dirty"];
    cargo(&root(), &folder, &arguments);
    for name in CRATES {
        let package = folder.join(format!("package/{name}-{}.crate", env!("CARGO_PKG_VERSION")));
        let bytes = fs::metadata(&package).unwrap().len();
        assert!(bytes < LARGEST_PACKAGE, "{name}: {bytes} bytes");
        let files = unpack(&package, &packages.join(name));
        for file in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
            assert!(files.iter().any(|found| found.ends_with(&format!("/{file}"))), "{files:?}");
        }
        let manifest = fs::read_to_string(packages.join(name).join("Cargo.toml")).unwrap();
        for key in ["description", "readme", "keywords", "categories", "documentation"] {
            assert!(manifest.contains(&format!("\n{key} = ")), "{name}: no {key}");
        }
        assert!(manifest.contains("[package.metadata.docs.rs]"), "{name}");
    }
    for part in ["hksl-train/configs/default.toml", "hksl-train/build.rs"] {
        assert!(packages.join(part).is_file(), "no {part}");
    }

    let project = folder.join("project");
    let source = root().join("tests/outside");
    fs::create_dir_all(project.join("src")).unwrap();
    fs::copy(source.join("src/main.rs"), project.join("src/main.rs")).unwrap();
    // With the profiles of the workspace, too, dependencies are compiled once.
    let mut own = manifest(&source);
    own.insert("profile".to_owned(), manifest(&root())["profile"].clone());
    fs::write(project.join("Cargo.toml"), own.to_string()).unwrap();
    // The versions of the workspace, which are compiled already.
    fs::copy(root().join("Cargo.lock"), project.join("Cargo.lock")).unwrap();
    let arguments = ["run", "--quiet", "--release"];
    let is_release = profile().ends_with("release");
    let said = cargo(&project, &target, if is_release { &arguments } else { &arguments[..2] });
    assert_eq!(said.matches("loss").count(), 2, "{said}");
}
