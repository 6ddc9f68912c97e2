//! Describes this build and the machine.

use hksl_core::kernels::Kernels;
use hksl_train::{COMMIT, instruction_sets};

use super::finding::Finding;

/// Version, commit and features of this program.
pub fn build() -> Finding {
    let feature = |compiled: bool| if compiled { "yes" } else { "no" };
    let found = format!(
        "hksl {}, commit {COMMIT}, features: mujoco {}, cuda {}",
        env!("CARGO_PKG_VERSION"),
        feature(cfg!(feature = "mujoco")),
        feature(cfg!(feature = "cuda")),
    );
    if cfg!(debug_assertions) {
        return Finding::warn("build", format!("{found}, unoptimised"), "build with --release");
    }
    Finding::ok("build", found)
}

/// Name and version of the operating system.
pub fn system() -> Finding {
    let read = |file| std::fs::read_to_string(file).ok();
    let distribution = read("/etc/os-release").and_then(|text| pretty_name(&text));
    let kernel = read("/proc/sys/kernel/osrelease").map(|text| format!("Linux {}", text.trim()));
    let parts = [distribution, kernel].into_iter().flatten();
    let mut parts: Vec<_> = parts.collect();
    if parts.is_empty() {
        parts.push(std::env::consts::OS.to_owned());
    }
    parts.push(std::env::consts::ARCH.to_owned());
    Finding::ok("system", parts.join(", "))
}

/// The distribution's name in /etc/os-release.
fn pretty_name(text: &str) -> Option<String> {
    let value = text.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="))?;
    Some(value.trim_matches(['"', '\'']).to_owned())
}

/// Cores, vector instructions, and the kernels chosen for them.
pub fn processor() -> Finding {
    let (model, cores) = described(&std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default());
    let allowed = std::thread::available_parallelism().map_or(1, usize::from);
    let kernels = Kernels::detect();
    let sets: Vec<_> = instruction_sets()
        .into_iter()
        .map(|(name, present)| if present { name.to_owned() } else { format!("no {name}") })
        .chain([format!("kernels: {kernels}")])
        .collect();
    let model = model.unwrap_or_else(|| "unnamed".to_owned());
    let found = format!("{model}, {}; {}", cores_in_words(allowed, cores), sets.join(", "));
    if allowed == 1 {
        let advice = "a full run takes days on one core: raise the core limit of the \
                      container or the job, or use another machine";
        return Finding::warn("CPU", found, advice);
    }
    if kernels == Kernels::portable() {
        let advice = "learning is several times slower than with AVX2, AVX-512 or NEON: use \
                      another processor, or a GPU";
        return Finding::warn("CPU", found, advice);
    }
    Finding::ok("CPU", found)
}

fn cores_in_words(allowed: usize, present: usize) -> String {
    let plural = |count| if count == 1 { "" } else { "s" };
    if allowed < present {
        format!("{allowed} of {present} logical cores allowed to this process")
    } else {
        format!("{allowed} logical core{}", plural(allowed))
    }
}

/// The first model name and the number of cores in /proc/cpuinfo.
fn described(text: &str) -> (Option<String>, usize) {
    let fields = || {
        let pairs = text.lines().filter_map(|line| line.split_once(':'));
        pairs.map(|(name, value)| (name.trim(), value.trim()))
    };
    let model = fields().find(|(name, _)| *name == "model name");
    let cores = fields().filter(|(name, _)| *name == "processor").count();
    (model.map(|(_, value)| value.to_owned()), cores)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_models_and_counts_cores() {
        let core = |number| {
            format!("processor\t: {number}\nmodel\t\t: 17\nmodel name\t: Some CPU @ 2 GHz\n\n")
        };
        let text: String = (0..3).map(core).collect();
        assert_eq!(described(&text), (Some("Some CPU @ 2 GHz".to_owned()), 3));
        assert_eq!(described("processor\t: 0\nBogoMIPS\t: 50.00\n"), (None, 1));
        assert_eq!(described(""), (None, 0));
    }

    #[test]
    fn cores_that_are_not_allowed_are_told() {
        assert_eq!(cores_in_words(2, 16), "2 of 16 logical cores allowed to this process");
        assert_eq!(cores_in_words(16, 16), "16 logical cores");
        // Where the system does not list them.
        assert_eq!(cores_in_words(1, 0), "1 logical core");
    }

    #[test]
    fn reads_a_distributions_name() {
        let text = "NAME=\"Debian GNU/Linux\"\nPRETTY_NAME=\"Debian GNU/Linux 12 (bookworm)\"\n";
        assert_eq!(pretty_name(text).as_deref(), Some("Debian GNU/Linux 12 (bookworm)"));
        assert_eq!(pretty_name("PRETTY_NAME=Alpine\n").as_deref(), Some("Alpine"));
        assert_eq!(pretty_name("NAME=x\n"), None);
    }

    #[test]
    fn the_build_names_its_commit_and_features() {
        let mut out = Vec::new();
        build().write(&mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        let mujoco = if cfg!(feature = "mujoco") { "mujoco yes" } else { "mujoco no" };
        assert!(text.contains(COMMIT) && text.contains(mujoco), "{text}");
    }
}
