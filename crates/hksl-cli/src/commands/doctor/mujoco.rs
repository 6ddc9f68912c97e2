//! MuJoCo, its model files, and drawing off-screen.

use std::time::Instant;

use anyhow::{Context, Result};
use hksl_envs::render::RenderDevice;
use hksl_envs::{Environment, TaskInfo};
use hksl_train::config::{Request, resolve};
use hksl_train::settings;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::finding::Finding;

/// Everything that the tasks of MuJoCo need, from the library to a picture.
pub fn examine() -> Vec<Finding> {
    let mut findings = vec![Finding::ok("MuJoCo", hksl_envs::dmc::mujoco_version())];
    let tasks: Vec<_> = hksl_envs::tasks().iter().filter(|info| info.needs_mujoco).collect();
    let environments: Result<Vec<_>> = tasks.into_iter().map(environment).collect();
    let environments = match environments {
        Ok(environments) => {
            findings.push(models(environments.len()));
            environments
        }
        Err(error) => {
            findings.push(Finding::fail("models", &error));
            Vec::new()
        }
    };
    match hksl_envs::render::renderer_description(RenderDevice::Auto { cuda: None }) {
        Ok(description) => {
            findings.push(Finding::ok("graphics", description.to_string()));
            findings.extend(devices());
            findings.extend(environments.into_iter().next().map(picture));
        }
        Err(error) => findings.push(Finding::fail("graphics", &error.into())),
    }
    findings
}

/// What `--render-device` can choose from.
fn devices() -> Option<Finding> {
    let devices = hksl_envs::render::devices().ok()?;
    let listed = devices.iter().enumerate().map(|(number, name)| format!("{number}: {name}"));
    Some(Finding::ok("EGL devices", listed.collect::<Vec<_>>().join(", ")))
}

fn environment(info: &TaskInfo) -> Result<Box<dyn Environment>> {
    let request = Request { task: Some(info.name.to_owned()), ..Request::default() };
    let settings = settings(&resolve(&request)?.config);
    Ok(hksl_envs::make(info.name, &settings, ChaCha8Rng::seed_from_u64(0))?)
}

fn models(count: usize) -> Finding {
    let folder = hksl_envs::models::folders().into_iter().find(|folder| folder.is_dir());
    let folder = folder.map(|folder| folder.display().to_string()).unwrap_or_default();
    let plural = if count == 1 { "" } else { "s" };
    Finding::ok("models", format!("{folder}, the model{plural} of {count} task{plural}"))
}

/// Draws one state twice: the two must be equal, and show something.
fn picture(mut environment: Box<dyn Environment>) -> Finding {
    let mut draw = || {
        environment.reset()?;
        let first = environment.frame()?;
        let start = Instant::now();
        let second = environment.frame()?;
        Ok::<_, hksl_envs::Error>((first, second, start.elapsed()))
    };
    let (first, second, time) = match draw().context("no picture") {
        Ok(drawn) => drawn,
        Err(error) => return Finding::fail("picture", &error),
    };
    let (channels, height, width) = first.dim();
    let found = format!(
        "{height} × {width} pixels, {channels} channels, {:.0} ms",
        time.as_secs_f64() * 1e3
    );
    if first.iter().all(|level| Some(level) == first.first()) {
        let blank = hksl_envs::Error::Graphics { reason: format!("{found}, but blank") };
        return Finding::fail("picture", &blank.into());
    }
    if first != second {
        let advice = "runs with this renderer cannot be repeated to the bit";
        return Finding::warn("picture", format!("{found}, different when drawn again"), advice);
    }
    Finding::ok("picture", format!("{found}, the same when drawn again"))
}
