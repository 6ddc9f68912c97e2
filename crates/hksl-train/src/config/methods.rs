//! The registry of learning methods: one row each.

use candle_core::Device;
use hksl_baselines::config::{DrqConfig, Vision};
use hksl_baselines::dreamer::{self, vision::ORIGINAL_SIDE};
use hksl_baselines::{Architecture, Curl, Dbc, DreamerV2, Drq, PiSac};
use hksl_core::kernels::Kernels;
use hksl_sac::Learner;
use hksl_sac::hksl::{self, Hksl};

use super::Config;

/// A learning method. `configs/methods/NAME.toml` is its layer of the configuration.
#[derive(Debug)]
pub struct Method {
    /// Its name on the command line and in folders.
    pub name: &'static str,
    /// One line about it, with its source.
    pub summary: &'static str,
    /// Presets that no other method has.
    pub(crate) presets: &'static [&'static str],
    /// The configuration sections that it reads in addition to those of every method.
    pub(crate) sections: &'static [&'static str],
    /// Whether it supports `--ablation`.
    pub has_ablations: bool,
    /// Whether a whole sequence shares one random shift, regardless of `augmentation.shift_per`.
    pub(crate) shifts_sequences: bool,
    /// Number of consecutive transitions that it samples, and the key that sets this number, if any.
    pub(crate) sampled: fn(&Config) -> (usize, Option<&'static str>),
    /// Agent steps between two learning steps.
    pub(crate) update_every: fn(&Config) -> u64,
    /// The key of the number of items in a batch, and its value.
    pub(crate) batch: fn(&mut Config) -> (&'static str, &mut usize),
    /// Checks what no key can check alone.
    pub(crate) check: fn(&Config) -> std::result::Result<(), Refusal>,
    /// Builds its networks.
    pub(crate) build: fn(&Config, &Build) -> hksl_sac::Result<Box<dyn Learner>>,
}

/// A value that a method refuses: key, value, and what would be valid.
pub(crate) type Refusal = (String, String, String);

/// Inputs for building networks, in addition to the configuration.
pub(crate) struct Build<'a> {
    /// Shape of one observation, `(C, H, W)`.
    pub(crate) observation: [usize; 3],
    /// Action dimensions.
    pub(crate) action_dims: usize,
    /// Where the networks live.
    pub(crate) device: &'a Device,
}

/// Defaults shared by most baselines.
const MODEL_FREE: Method = Method {
    name: "",
    summary: "",
    presets: &[],
    sections: &["sac", "baseline"],
    has_ablations: false,
    shifts_sequences: false,
    sampled: |_| (1, None),
    update_every: |_| 1,
    batch: |config| ("sac.batch_size", &mut config.sac.batch_size),
    check: |_| Ok(()),
    build: |config, to| Ok(Box::new(drq(DrqConfig::ONE_VIEW, config, to)?)),
};

/// Every method. The first is the default.
pub const METHODS: &[Method] = &[
    Method {
        name: "hksl",
        summary: "hierarchical k-step latents (McInroe et al., 2024)",
        sections: &["sac", "hksl"],
        has_ablations: true,
        sampled: |config| (config.hksl.trajectory_length, Some("hksl.trajectory_length")),
        check: check_hierarchy,
        build: |config, to| Ok(Box::new(hksl(config, to)?)),
        ..MODEL_FREE
    },
    Method {
        name: "sac",
        summary: "soft actor-critic with the random shift alone (Haarnoja et al., 2018)",
        ..MODEL_FREE
    },
    Method {
        name: "drq",
        summary: "targets and losses averaged over shifted views (Kostrikov et al., 2021)",
        sections: &["sac", "baseline", "drq"],
        build: |config, to| Ok(Box::new(drq(config.drq.clone(), config, to)?)),
        ..MODEL_FREE
    },
    Method {
        name: "curl",
        summary: "a contrastive loss between two views (Laskin et al., 2020)",
        sections: &["sac", "baseline", "curl"],
        build: |config, to| {
            let (kernels, architecture) = (Kernels::detect(), architecture(config, to));
            Ok(Box::new(Curl::new(architecture, &config.curl, kernels, config.seed, to.device)?))
        },
        ..MODEL_FREE
    },
    Method {
        name: "pi-sac",
        summary: "compressed predictive information (Lee et al., 2020)",
        sections: &["sac", "baseline", "pi_sac"],
        sampled: |config| (config.environment.frame_stack + 1, None),
        build: |config, to| {
            let (kernels, architecture) = (Kernels::detect(), architecture(config, to));
            let (settings, frames) = (config.pi_sac.clone(), config.environment.frame_stack);
            let seed = config.seed;
            Ok(Box::new(PiSac::new(architecture, settings, frames, kernels, seed, to.device)?))
        },
        ..MODEL_FREE
    },
    Method {
        name: "dbc",
        summary: "deep bisimulation for control (Zhang et al., 2021)",
        sections: &["sac", "baseline", "dbc"],
        build: |config, to| {
            let (kernels, architecture) = (Kernels::detect(), architecture(config, to));
            let settings = config.dbc.clone();
            Ok(Box::new(Dbc::new(architecture, settings, kernels, config.seed, to.device)?))
        },
        ..MODEL_FREE
    },
    Method {
        name: "dreamer-v2",
        summary: "a world model, and a policy that learns in imagination (Hafner et al., 2021)",
        presets: &["original"],
        sections: &["dreamer"],
        shifts_sequences: true,
        sampled: |config| (config.dreamer.sequence_length - 1, None),
        update_every: |config| config.dreamer.train_every,
        batch: |config| ("dreamer.batch_sequences", &mut config.dreamer.batch_sequences),
        check: check_original_vision,
        build: |config, to| {
            let sizes = dreamer::Sizes {
                observation: to.observation,
                action_dims: to.action_dims,
                encoder: config.encoder,
                config: config.dreamer.clone(),
            };
            Ok(Box::new(DreamerV2::new(sizes, Kernels::detect(), config.seed, to.device)?))
        },
        ..MODEL_FREE
    },
];

/// The method of a run that names none.
pub fn default_method() -> &'static str {
    METHODS[0].name
}

/// The method of that name.
pub fn find(name: &str) -> Option<&'static Method> {
    METHODS.iter().find(|method| method.name == name)
}

/// HKSL's networks, as this configuration describes them.
pub(crate) fn hksl(config: &Config, to: &Build) -> hksl_sac::Result<Hksl> {
    let architecture = hksl::Architecture {
        observation: to.observation,
        action_dims: to.action_dims,
        encoder: config.encoder,
        hksl: config.hksl.clone(),
        sac: config.sac.clone(),
    };
    Hksl::new(architecture, config.seed, to.device)
}

fn drq(settings: DrqConfig, config: &Config, to: &Build) -> hksl_sac::Result<Drq> {
    let (kernels, architecture) = (Kernels::detect(), architecture(config, to));
    Drq::new(architecture, settings, kernels, config.seed, to.device)
}

fn architecture(config: &Config, to: &Build) -> Architecture {
    Architecture {
        observation: to.observation,
        action_dims: to.action_dims,
        encoder: config.encoder,
        sac: config.sac.clone(),
        baseline: config.baseline.clone(),
    }
}

fn check_hierarchy(config: &Config) -> std::result::Result<(), Refusal> {
    let hksl = &config.hksl;
    let architecture = hksl::Architecture {
        // Set by the task; the configuration cannot make it invalid.
        observation: [0; 3],
        action_dims: 1,
        encoder: config.encoder,
        hksl: hksl.clone(),
        sac: config.sac.clone(),
    };
    architecture.hierarchy().validate().map_err(|error| match error {
        hksl_core::Error::Setting { name, value, expected } => {
            (name.to_string(), value.to_string(), expected.to_string())
        }
        error => ("hksl".to_owned(), String::new(), error.to_string()),
    })
}

/// The original layers work only for one frame size.
fn check_original_vision(config: &Config) -> std::result::Result<(), Refusal> {
    let [height, width] = config.frame_size();
    let fits = (height, width) == (ORIGINAL_SIDE, ORIGINAL_SIDE);
    if config.dreamer.vision == Vision::Shared || fits {
        return Ok(());
    }
    let expected = format!(
        "the original encoder needs frames of {ORIGINAL_SIDE}×{ORIGINAL_SIDE}, but they are {height}×{width}; set \
         dreamer.vision to shared, or environment.height and environment.width to {ORIGINAL_SIDE} without a border"
    );
    Err(("dreamer.vision".to_owned(), "original".to_owned(), expected))
}
