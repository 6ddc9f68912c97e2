//! What is said where a native part is missing. Each test runs itself again in a process whose
//! environment lacks that part.

use std::path::Path;
use std::process::Command;

use hksl_envs::{Environment, Error, Settings, make};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const SETTINGS: Settings = Settings::new(84, 84, 1000);
const CHILD: &str = "HKSL_TEST_CHILD";

fn cartpole() -> Result<Box<dyn Environment>, Error> {
    make("cartpole-swingup", &SETTINGS, ChaCha8Rng::seed_from_u64(0))
}

/// True in the process that lacks the part.
fn in_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

fn run_child(test: &str, variable: &str, value: &Path) {
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", &format!("missing_parts::{test}"), "--nocapture"])
        .env(CHILD, "1")
        .env(variable, value)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("1 passed"), "{said}");
}

#[test]
fn missing_models() {
    if in_child() {
        let error = cartpole().err().unwrap();
        let message = error.to_string();
        assert!(error.is_native());
        for part in ["suite/cartpole.xml", "no-models-here", "make setup", "HKSL_MODELS"] {
            assert!(message.contains(part), "'{message}' lacks '{part}'");
        }
        return;
    }
    run_child("missing_models", "HKSL_MODELS", Path::new("/no-models-here"));
}

/// A copy of the suite's models.
fn models() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let suite = hksl_envs::models::find("suite/cartpole.xml").unwrap();
    let suite = suite.parent().unwrap();
    std::fs::create_dir_all(folder.path().join("suite/common")).unwrap();
    for file in ["cartpole.xml", "common/materials.xml", "common/skybox.xml", "common/visual.xml"] {
        std::fs::copy(suite.join(file), folder.path().join("suite").join(file)).unwrap();
    }
    folder
}

fn refused_model(parts: &[&str]) {
    let error = cartpole().err().unwrap();
    assert!(error.is_native() && matches!(error, Error::Model { .. }), "{error}");
    let message = error.to_string();
    for part in ["cartpole-swingup", "make setup", "HKSL_MODELS"].iter().chain(parts) {
        assert!(message.contains(part), "'{message}' lacks '{part}'");
    }
}

#[test]
fn damaged_model() {
    if in_child() {
        return refused_model(&["suite/cartpole.xml", "SHA-256", "dm_control 1.0.50"]);
    }
    let folder = models();
    std::fs::write(folder.path().join("suite/cartpole.xml"), "<mujoco><worldbody>").unwrap();
    run_child("damaged_model", "HKSL_MODELS", folder.path());
}

#[test]
fn model_of_another_version() {
    if in_child() {
        return refused_model(&["suite/cartpole.xml", "SHA-256", "dm_control 1.0.50"]);
    }
    let folder = models();
    let path = folder.path().join("suite/cartpole.xml");
    let model = std::fs::read_to_string(&path).unwrap();
    let heavier = model.replacen("mass=\"1\"", "mass=\"1.1\"", 1);
    assert_ne!(model, heavier);
    std::fs::write(path, heavier).unwrap();
    run_child("model_of_another_version", "HKSL_MODELS", folder.path());
}

#[test]
fn model_without_what_it_includes() {
    if in_child() {
        return refused_model(&["suite/common/skybox.xml", "No such file"]);
    }
    let folder = models();
    std::fs::remove_file(folder.path().join("suite/common/skybox.xml")).unwrap();
    run_child("model_without_what_it_includes", "HKSL_MODELS", folder.path());
}

#[test]
fn missing_graphics_leave_physics_alone() {
    if in_child() {
        let mut task = cartpole().unwrap();
        task.reset().unwrap();
        task.step(&[0.5]).unwrap();
        let error = task.frame().unwrap_err();
        assert!(error.is_native());
        let message = error.to_string();
        assert!(message.contains("libegl1") && message.contains("libgl1-mesa-dri"), "{message}");
        assert!(
            hksl_envs::render::renderer_description(hksl_envs::render::RenderDevice::Auto {
                cuda: None
            })
            .unwrap_err()
            .is_native()
        );
        task.step(&[0.5]).unwrap();
        return;
    }
    // An empty file in the library's place is a library that cannot be loaded.
    let folder = tempfile::tempdir().unwrap();
    for name in ["libEGL.so", "libEGL.so.1"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    run_child("missing_graphics_leave_physics_alone", "LD_LIBRARY_PATH", folder.path());
}
