//! Build script shared by every crate whose executables (binary, tests, examples) load libmujoco.
//! It gives hksl-train the commit as well, for each run's environment.json.
//!
//! mujoco-rs says where to link the library, not where to find it at run time. Two run paths
//! are written into the executable instead, so that nobody sets LD_LIBRARY_PATH: beside an
//! installed binary (PREFIX/bin/hksl next to PREFIX/lib/hksl; in a Python package, its folder `native`), then the folder
//! it was linked from.

use std::env;
use std::path::Path;
use std::process::Command;

/// The folder that mujoco-rs links from; `.cargo/config.toml` sets it.
const LINK_DIRECTORY: &str = "MUJOCO_DYNAMIC_LINK_DIR";

fn main() {
    for script in ["../scripts/mujoco_rpath.rs", "../../scripts/mujoco_rpath.rs"] {
        if Path::new(script).is_file() {
            println!("cargo::rerun-if-changed={script}");
        }
    }
    println!("cargo::rerun-if-env-changed={LINK_DIRECTORY}");
    if env::var("CARGO_PKG_NAME").is_ok_and(|name| name == "hksl-train") {
        name_commit();
    }
    let wants_mujoco = env::var_os("CARGO_FEATURE_MUJOCO").is_some();
    let on_linux = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux");
    if !wants_mujoco || !on_linux {
        return;
    }
    // The Python package carries it in a folder of its own, and is not run where it is built.
    let packaged = env::var("CARGO_PKG_NAME").is_ok_and(|name| name == "hksl-py");
    let installed = if packaged { "native" } else { "../lib/hksl" };
    println!("cargo::rustc-link-arg=-Wl,-rpath,$ORIGIN/{installed}");
    let Ok(folder) = env::var(LINK_DIRECTORY) else { return };
    println!("cargo::rerun-if-changed={folder}/libmujoco.so");
    if !Path::new(&folder).join("libmujoco.so").is_file() && env::var_os("DOCS_RS").is_none() {
        println!(
            "cargo::error=MuJoCo's library is missing: no libmujoco.so in '{folder}'. Run `make \
             setup`, which fetches it, or build without it: --no-default-features"
        );
        return;
    }
    if !packaged {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
    }
}

/// Sets HKSL_COMMIT where the sources are a git checkout.
fn name_commit() {
    let arguments = ["describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"];
    let Ok(output) = Command::new("git").args(arguments).output() else { return };
    if !output.status.success() {
        return;
    }
    // The log grows with every commit, whatever the branch. A change that is in no commit makes the name a dirty one.
    println!("cargo::rerun-if-changed=../../.git/logs/HEAD");
    println!("cargo::rerun-if-changed=../../configs");
    for sources in
        ["hksl-core", "hksl-files", "hksl-envs", "hksl-sac", "hksl-baselines", "hksl-train"]
    {
        println!("cargo::rerun-if-changed=../{sources}/src");
    }
    println!("cargo::rustc-env=HKSL_COMMIT={}", String::from_utf8_lossy(&output.stdout).trim());
}
