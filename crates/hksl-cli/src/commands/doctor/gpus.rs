//! Checks for NVIDIA GPUs and whether this build can train on them.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use candle_core::{DType, Device, Tensor};
use hksl_core::nn::{Initialisation, LayerNorm};
use hksl_core::{Builder, Parameters, rng};
use hksl_train::config::DeviceChoice;
use hksl_train::device;

use super::finding::Finding;

/// Folder in which NVIDIA's Linux driver describes each device.
const DRIVER_FOLDER: &str = "/proc/driver/nvidia/gpus";
const QUERY: [&str; 2] = ["--query-gpu=name,memory.total,driver_version", "--format=csv,noheader"];
/// Time limit; a working driver answers within a second.
const PATIENCE: Duration = Duration::from_secs(5);

/// Result of `nvidia-smi`.
#[derive(Debug, PartialEq, Eq)]
enum Answer {
    /// One line per GPU, possibly none.
    Gpus(Vec<String>),
    /// Not installed, or without a driver.
    Absent,
    /// Timed out.
    Silent,
}

/// Whether training works on a GPU.
#[derive(Debug)]
enum Training {
    /// Not supported by this build.
    LeftOut,
    /// Works, on the device of this name.
    On(String),
    /// Supported, but fails.
    Fails(String),
}

/// Lists the GPUs and tries to train on one.
pub fn examine() -> Finding {
    let answer = ask(Command::new("nvidia-smi").args(QUERY), PATIENCE);
    if answer == Answer::Silent {
        let found = format!("nvidia-smi did not answer within {} s", PATIENCE.as_secs());
        let advice = "the driver hangs: search `dmesg` for `NVRM`, and restart the machine";
        return Finding::warn("GPUs", found, advice);
    }
    let gpus = match answer {
        Answer::Gpus(gpus) if !gpus.is_empty() => gpus,
        _ => driver_models(Path::new(DRIVER_FOLDER)),
    };
    // Without a GPU, CUDA is not opened, because its libraries may be missing.
    let training = if gpus.is_empty() { Training::LeftOut } else { training() };
    judge(&gpus, &training, cfg!(feature = "cuda"))
}

fn judge(gpus: &[String], training: &Training, built_with_cuda: bool) -> Finding {
    let listed = gpus.join("; ");
    match training {
        _ if gpus.is_empty() && built_with_cuda => Finding::warn(
            "GPUs",
            "none found; training runs on the CPU",
            "this build supports CUDA: install NVIDIA's driver, or give the container or the job \
             access to a GPU (docker --gpus all, sbatch --gres=gpu:1)",
        ),
        _ if gpus.is_empty() => Finding::ok("GPUs", "none found; training runs on the CPU"),
        Training::LeftOut => Finding::warn(
            "GPUs",
            format!("{listed}; not used by this build"),
            "build with --features cuda to train on it",
        ),
        Training::On(device) => Finding::ok("GPUs", format!("{listed}; training runs on {device}")),
        Training::Fails(reason) => Finding::warn(
            "GPUs",
            format!("{listed}; training on them fails: {reason}"),
            "compare the driver's version with that of the CUDA toolkit that hksl was built with; \
             update the driver, or build with an older toolkit",
        ),
    }
}

fn training() -> Training {
    if !cfg!(feature = "cuda") {
        return Training::LeftOut;
    }
    match device::open(DeviceChoice::Cuda(0)) {
        Ok(opened) => match try_kernel(&opened) {
            Ok(()) => Training::On(device::name(&opened)),
            Err(error) => Training::Fails(error.to_string()),
        },
        Err(error) => Training::Fails(error.to_string()),
    }
}

/// Compiles the GPU kernels and runs one.
fn try_kernel(gpu: &Device) -> hksl_core::Result<()> {
    let (mut parameters, mut random) = (Parameters::default(), rng::stream(0, "doctor"));
    let mut builder = Builder::create(&mut parameters, &mut random, Initialisation::Uniform, gpu);
    let norm = LayerNorm::new(&mut builder, 4)?;
    norm.forward(&Tensor::ones((2, 4), DType::F32, gpu)?)?.to_vec2::<f32>()?;
    Ok(())
}

/// Runs `nvidia-smi`, or a program with the same output.
fn ask(command: &mut Command, patience: Duration) -> Answer {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let Ok(mut child) = command.spawn() else { return Answer::Absent };
    match ended_well(&mut child, patience) {
        Some(true) => {
            let mut text = String::new();
            let read = child.stdout.take().map(|mut pipe| pipe.read_to_string(&mut text));
            match read {
                Some(Ok(_)) => Answer::Gpus(text.lines().filter_map(described).collect()),
                _ => Answer::Absent,
            }
        }
        Some(false) => Answer::Absent,
        None => {
            // Not waited for: a process that hangs in the driver may not end even when killed.
            let _ = child.kill();
            Answer::Silent
        }
    }
}

/// Whether the process succeeded; none if it runs longer than `patience`.
fn ended_well(child: &mut Child, patience: Duration) -> Option<bool> {
    let start = Instant::now();
    while start.elapsed() < patience {
        match child.try_wait() {
            Ok(Some(status)) => return Some(status.success()),
            Ok(None) => std::thread::sleep(Duration::from_millis(10)),
            Err(_) => return Some(false),
        }
    }
    None
}

/// Formats a line of `nvidia-smi` such as `NVIDIA A40, 46068 MiB, 535.129.03`.
fn described(line: &str) -> Option<String> {
    let mut parts = line.trim().rsplitn(3, ", ");
    let (driver, memory, name) = (parts.next()?, parts.next()?, parts.next()?);
    Some(format!("{name}, {memory}, driver {driver}"))
}

/// GPU models listed by the driver.
fn driver_models(folder: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let files = entries.flatten().map(|entry| entry.path().join("information"));
    let mut models: Vec<_> =
        files.filter_map(|file| model(&std::fs::read_to_string(file).ok()?)).collect();
    models.sort();
    models
}

/// The model in a device's `information` file.
fn model(text: &str) -> Option<String> {
    let name = text.lines().find_map(|line| line.strip_prefix("Model:"))?.trim();
    (!name.is_empty()).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(finding: &Finding) -> String {
        let mut out = Vec::new();
        finding.write(&mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn each_build_is_told_what_it_can_do_with_what_there_is() {
        let gpu = ["NVIDIA A40, 46068 MiB, driver 535.129.03".to_owned()];
        assert!(judge(&[], &Training::LeftOut, false).is_fine());
        let missing = judge(&[], &Training::LeftOut, true);
        assert!(!missing.is_fine() && shown(&missing).contains("driver"));
        let unused = judge(&gpu, &Training::LeftOut, false);
        assert!(!unused.is_fine() && shown(&unused).contains("--features cuda"));
        let used = judge(&gpu, &Training::On("cuda:0".into()), true);
        assert!(used.is_fine() && shown(&used).contains("A40") && shown(&used).contains("cuda:0"));
        let failing = judge(&gpu, &Training::Fails("an old driver".into()), true);
        assert!(!failing.is_fine() && shown(&failing).contains("an old driver"));
    }

    #[test]
    fn reads_lines_of_nvidia_smi() {
        let line = "NVIDIA H100 80GB HBM3, 81559 MiB, 535.129.03";
        let expected = "NVIDIA H100 80GB HBM3, 81559 MiB, driver 535.129.03";
        assert_eq!(described(line).as_deref(), Some(expected));
        let expected = "A, B, [N/A], driver 1";
        assert_eq!(described("A, B, [N/A], 1\r").as_deref(), Some(expected));
        assert_eq!(described("No devices were found"), None);
    }

    #[test]
    fn reads_what_the_driver_lists() {
        let folder = tempfile::tempdir().unwrap();
        for (bus, text) in [
            (
                "0000:01:00.0",
                "Model: \t\t NVIDIA A40\nIRQ:   \t\t 99\nBus Location: 0000:01:00.0\n",
            ),
            ("0000:00:00.0", "IRQ:   \t\t 98\nModel: \t\t NVIDIA A100-SXM4-80GB\n"),
            ("0000:02:00.0", "IRQ: 97\n"),
        ] {
            std::fs::create_dir(folder.path().join(bus)).unwrap();
            std::fs::write(folder.path().join(bus).join("information"), text).unwrap();
        }
        assert_eq!(driver_models(folder.path()), ["NVIDIA A100-SXM4-80GB", "NVIDIA A40"]);
        assert_eq!(driver_models(&folder.path().join("absent")), Vec::<String>::new());
    }

    #[test]
    fn a_program_that_is_absent_is_not_waited_for() {
        assert_eq!(ask(&mut Command::new("/nonexistent/nvidia-smi"), PATIENCE), Answer::Absent);
    }

    #[cfg(unix)]
    #[test]
    fn a_program_may_answer_fail_or_hang() {
        let said = |script: &str, patience| ask(Command::new("sh").args(["-c", script]), patience);
        let line = "echo 'NVIDIA A40, 46068 MiB, 535.1'";
        let expected = Answer::Gpus(vec!["NVIDIA A40, 46068 MiB, driver 535.1".into()]);
        assert_eq!(said(line, PATIENCE), expected);
        assert_eq!(said(&format!("{line}; exit 9"), PATIENCE), Answer::Absent);
        assert_eq!(said("echo No devices were found", PATIENCE), Answer::Gpus(Vec::new()));
        assert_eq!(said("exec sleep 60", Duration::from_millis(50)), Answer::Silent);
    }
}
