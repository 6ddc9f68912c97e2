//! What `environment.json` says: everything outside the configuration that can move a number.

use std::collections::BTreeMap;

use candle_core::{Device, utils};
use hksl_envs::Spec;
use serde_json::{Value, json};

use super::Plan;
use crate::config::Config;
use crate::device;
use crate::version::COMMIT;

/// The fact that specifies the environment of a task which is not in the registry.
pub(crate) const SPECIFICATION: &str = "specification";
/// The fact that says which spaces it has, if it is another program's.
pub(crate) const INTERFACE: &str = "interface";

pub(super) fn gather(plan: &Plan, spec: &Spec) -> BTreeMap<String, Value> {
    let Plan { config, factories, device: target, .. } = plan;
    let sets = instruction_sets().into_iter().filter(|(_, present)| *present);
    let sets: Vec<_> = sets.map(|(name, _)| name).collect();
    let mut facts = BTreeMap::from([
        ("hksl".to_owned(), json!(env!("CARGO_PKG_VERSION"))),
        ("commit".to_owned(), json!(COMMIT)),
        ("operating_system".to_owned(), json!(std::env::consts::OS)),
        ("architecture".to_owned(), json!(std::env::consts::ARCH)),
        ("instruction_sets".to_owned(), json!(sets)),
        ("kernels".to_owned(), json!(kernels(target))),
        ("matrix_threads".to_owned(), json!(utils::get_num_threads())),
        ("threads".to_owned(), json!(rayon::current_num_threads())),
        ("device".to_owned(), json!(device::name(target))),
    ]);
    facts.extend(device::gpu_name(target).map(|name| ("gpu".to_owned(), json!(name))));
    facts.extend(native_facts(config));
    if hksl_envs::registry::find(&config.task).is_err() {
        // The registry cannot say it to whoever opens the run.
        facts.insert(SPECIFICATION.to_owned(), json!(spec));
        let interface = factories.interface();
        facts.extend(interface.map(|interface| (INTERFACE.to_owned(), json!(interface))));
    }
    facts
}

/// What computes: the instructions of the CPU's kernels, or `cuda`.
fn kernels(target: &Device) -> &'static str {
    if target.is_cpu() { hksl_core::kernels::Kernels::detect().name() } else { "cuda" }
}

/// The vector instructions that the kernels can use, and whether this processor has them.
pub fn instruction_sets() -> Vec<(&'static str, bool)> {
    #[cfg(target_arch = "x86_64")]
    return vec![
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    return Vec::new();
}

#[cfg(feature = "mujoco")]
/// Versions and renderer of the native parts that a configuration's environment runs on.
pub fn native_facts(config: &Config) -> BTreeMap<String, Value> {
    let needs_mujoco =
        hksl_envs::registry::find(&config.task).is_ok_and(|information| information.needs_mujoco);
    if !needs_mujoco {
        return BTreeMap::new();
    }
    let mut facts =
        BTreeMap::from([("mujoco".to_owned(), json!(hksl_envs::dmc::mujoco_version()))]);
    if let Ok(renderer) = hksl_envs::render::renderer_description(config.render_device()) {
        facts.insert("renderer".to_owned(), json!(renderer.to_string()));
    }
    facts
}

#[cfg(not(feature = "mujoco"))]
/// Without MuJoCo there are no native parts.
pub fn native_facts(_: &Config) -> BTreeMap<String, Value> {
    BTreeMap::new()
}
