//! Checks MuJoCo, its model files and off-screen rendering.

use anyhow::Result;
use hksl_envs::render::{RenderDevice, RendererDescription};
use hksl_envs::{Error, TaskInfo};
use hksl_train::config::{Request, resolve};
use hksl_train::settings;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::finding::Finding;
use super::test_frame;

/// Checks everything that MuJoCo tasks need, from the library to a rendered frame.
pub fn examine() -> Vec<Finding> {
    let (library, models) = (library(), models());
    let models_are_fine = models.is_fine();
    let mut findings = vec![library, models];
    match hksl_envs::render::renderer_description(RenderDevice::Auto { cuda: None }) {
        Ok(description) => {
            findings.push(graphics(&description));
            findings.extend(devices());
            if models_are_fine {
                findings.extend(test_frame::examine(&description));
            }
        }
        Err(error) => {
            let advice = match error {
                Error::RenderDevice { .. } => {
                    "set MUJOCO_EGL_DEVICE_ID to one of these devices, or unset it"
                }
                _ => {
                    "to render on a GPU, install NVIDIA's driver with EGL (in a container: \
                     NVIDIA_DRIVER_CAPABILITIES=all); falling-pixels needs no graphics"
                }
            };
            findings.push(Finding::fail("graphics", &error.into(), advice));
            findings.extend(devices());
        }
    }
    findings
}

/// Version and path of the loaded library.
fn library() -> Finding {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let path = loaded_from(&maps).unwrap_or("unknown on this system");
    Finding::ok("MuJoCo", format!("{}, library path: {path}", hksl_envs::dmc::mujoco_version()))
}

/// Path of libmujoco in a process's memory map.
fn loaded_from(maps: &str) -> Option<&str> {
    let paths = maps.lines().filter_map(|line| line.find('/').map(|start| &line[start..]));
    let is_mujoco =
        |path: &&str| path.rsplit('/').next().is_some_and(|name| name.starts_with("libmujoco"));
    paths.into_iter().find(is_mujoco)
}

/// Loads the model of every task, which verifies the files' hashes.
fn models() -> Finding {
    let tasks: Vec<_> = hksl_envs::tasks().iter().filter(|info| info.needs_mujoco).collect();
    let loaded: Result<Vec<()>> = tasks.iter().map(|info| load(info)).collect();
    if let Err(error) = loaded {
        let advice = "run `make setup` to fetch missing or damaged files; falling-pixels needs no \
                      models";
        return Finding::fail("models", &error, advice);
    }
    let file = hksl_envs::models::find("suite/cartpole.xml").ok();
    let folder = file.and_then(|file| Some(file.parent()?.display().to_string()));
    let names: Vec<_> = tasks.iter().map(|info| info.name).collect();
    let found = format!(
        "{}: models of {}, verified against the SHA-256 of dm_control 1.0.50",
        folder.unwrap_or_default(),
        names.join(", ")
    );
    Finding::ok("models", found)
}

fn load(info: &TaskInfo) -> Result<()> {
    let request = Request { task: Some(info.name.to_owned()), ..Request::default() };
    let settings = settings(&resolve(&request)?.config);
    hksl_envs::make(info.name, &settings, ChaCha8Rng::seed_from_u64(0))?;
    Ok(())
}

fn graphics(description: &RendererDescription) -> Finding {
    let RendererDescription { device, software, egl } = description;
    let place = if description.is_on_cpu() { "rendering on the CPU" } else { "rendering on a GPU" };
    Finding::ok("graphics", format!("{software}; EGL: {egl}; {place} (EGL device {device})"))
}

/// The EGL devices to choose from with `--render-device`.
fn devices() -> Option<Finding> {
    let devices = hksl_envs::render::devices().ok()?;
    let listed = devices.iter().enumerate().map(|(number, name)| format!("{number}: {name}"));
    Some(Finding::ok("EGL devices", listed.collect::<Vec<_>>().join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_found_among_what_is_mapped() {
        let maps = "\
55d0c0a0-55d0c0b0 r-xp 00001000 fe:00 17 /opt/libmujoco/bin/hksl
7f1c10000000-7f1c10021000 rw-p 00000000 00:00 0
7f1c20000000-7f1c20100000 r--p 00000000 fe:00 4711                       /home/a b/lib/libmujoco.so.3.17.0
7ffc00000000-7ffc00021000 rw-p 00000000 00:00 0                          [stack]
";
        assert_eq!(loaded_from(maps), Some("/home/a b/lib/libmujoco.so.3.17.0"));
        assert_eq!(loaded_from(&maps.replace("lib/libmujoco", "lib/libother")), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_library_of_this_process_is_found() {
        // Keeps the linker from leaving the library out.
        assert!(!hksl_envs::dmc::mujoco_version().is_empty());
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
        assert!(std::path::Path::new(loaded_from(&maps).unwrap()).is_file());
    }

    #[test]
    fn software_and_graphics_cards_are_told_apart() {
        let shown = |software: &str| {
            let (software, egl) = (software.to_owned(), "Mesa Project, 1.5".to_owned());
            let mut out = Vec::new();
            let description = RendererDescription { device: 3, software, egl };
            graphics(&description).write(&mut out).unwrap();
            String::from_utf8(out).unwrap()
        };
        let software = shown("Mesa, llvmpipe (LLVM 15.0.6, 256 bits), 4.5 Mesa 22.3.6");
        for words in ["rendering on the CPU", "Mesa Project", "device 3"] {
            assert!(software.contains(words), "no `{words}` in: {software}");
        }
        let card = shown("NVIDIA Corporation, NVIDIA A40/PCIe/SSE2, 4.6.0 NVIDIA 535.1");
        assert!(card.contains("rendering on a GPU"), "{card}");
    }
}
