//! Reads reference files for the tests of hksl-core and hksl-sac.
#![allow(dead_code, clippy::unwrap_used)]

#[path = "common.rs"]
mod common;

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{DType, Tensor};
pub use common::{device, largest};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{Initialisation, PixelEncoder, PixelEncoderConfig};
use hksl_core::{Hierarchy, HierarchyConfig, Parameters, Trajectories, rng};
use serde::Deserialize;

/// Sizes from a file's metadata.
#[derive(Debug, Deserialize)]
pub struct Sizes {
    pub obs: [usize; 3],
    pub action: usize,
    pub skips: Vec<usize>,
    pub k: usize,
    pub filters: usize,
    pub latent: usize,
    pub hidden: usize,
    pub communication_hidden: usize,
    pub discount: f64,
    pub q_tau: f64,
    pub encoder_tau: f64,
}

/// A reference file.
pub struct Case {
    pub name: String,
    pub sizes: Sizes,
    tensors: BTreeMap<String, Tensor>,
}

/// Every reference file with every set of kernels of this CPU. A GPU has one set.
pub fn cases_and_kernels() -> Vec<(Case, Kernels)> {
    let mut sets = Kernels::available();
    if !device().is_cpu() {
        sets.truncate(1);
    }
    sets.into_iter().flat_map(|set| cases().into_iter().map(move |case| (case, set))).collect()
}

/// Every reference file, ordered by name.
fn cases() -> Vec<Case> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../hksl-core/tests/golden");
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "safetensors"))
        .collect();
    files.sort();
    assert!(!files.is_empty(), "no golden files in {}", folder.display());
    files.iter().map(|path| read(path)).collect()
}

fn read(path: &Path) -> Case {
    let bytes = std::fs::read(path).unwrap();
    let (_, header) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
    let metadata = header.metadata().as_ref().unwrap();
    let sizes: Sizes = serde_json::from_str(&metadata["config"]).unwrap();
    let (height, width) = PixelEncoder::map_size(sizes.obs[1], sizes.obs[2]).unwrap();
    let device = device();
    let tensors = hksl_core::from_safetensors(&bytes)
        .unwrap()
        .into_iter()
        .map(|(name, tensor)| {
            // Only the linear layers of encoders have this name.
            let tensor = if name.ends_with("linear.weight") {
                tensor
                    .reshape((sizes.latent, sizes.filters, height, width))
                    .and_then(|weight| weight.permute((0, 2, 3, 1))?.flatten_from(1))
                    .unwrap()
            } else {
                tensor
            };
            (name, tensor.to_device(&device).unwrap())
        })
        .collect();
    let name = path.file_stem().unwrap().to_string_lossy().into_owned();
    Case { name, sizes, tensors }
}

impl Case {
    pub fn tensor(&self, name: &str) -> &Tensor {
        self.tensors.get(name).unwrap_or_else(|| panic!("{} lacks {name}", self.name))
    }

    /// All tensors under a prefix, with the prefix removed from their names.
    pub fn under(&self, prefix: &str) -> BTreeMap<String, Tensor> {
        self.tensors
            .iter()
            .filter_map(|(name, tensor)| {
                Some((name.strip_prefix(prefix)?.to_owned(), tensor.clone()))
            })
            .collect()
    }

    pub fn hierarchy_config(&self) -> HierarchyConfig {
        HierarchyConfig {
            skips: self.sizes.skips.clone(),
            trajectory_length: self.sizes.k,
            action_dims: self.sizes.action,
            latent_dims: self.sizes.latent,
            communication_hidden: self.sizes.communication_hidden,
            communication: true,
            projection: true,
            shared_encoder: false,
        }
    }

    pub fn encoder_config(&self) -> PixelEncoderConfig {
        PixelEncoderConfig { filters: self.sizes.filters, latent_dims: self.sizes.latent }
    }

    /// The hierarchy with the file's weights and these kernels.
    pub fn hierarchy(&self, kernels: Kernels) -> Hierarchy<PixelEncoder> {
        let mut parameters = Parameters::with_kernels(kernels);
        let hierarchy = Hierarchy::new(
            self.hierarchy_config(),
            &mut parameters,
            &mut rng::stream(0, "init"),
            Initialisation::Uniform,
            self.tensors["input.obs"].device(),
            |builder| PixelEncoder::new(builder, self.sizes.obs, self.encoder_config()),
        )
        .unwrap();
        let mut weights = self.under("before.");
        weights.retain(|name, _| name.starts_with("levels.") || name.starts_with("momentum."));
        parameters.load(&weights).unwrap();
        hierarchy
    }

    /// The file's batch of trajectories.
    pub fn trajectories(&self) -> Trajectories {
        let observations = self.tensor("input.obs").transpose(0, 1).unwrap().contiguous().unwrap();
        Trajectories { observations, actions: self.tensor("input.actions").clone() }
    }

    /// Asserts `|got − expected| ≤ tolerance · max|expected|` for all elements.
    pub fn check(&self, name: &str, got: &Tensor, tolerance: f64) {
        self.check_within(tolerance, largest(self.tensor(name)), name, &self.off(name, got));
    }

    /// Asserts a parameter's values after the step, with a tolerance relative to the largest change in its tensor. Weights
    /// marked as unclear in the file must only be finite.
    pub fn check_movement(&self, name: &str, got: &Tensor, tolerance: f64) {
        let after = format!("after.{name}");
        let movement = (self.tensor(&after) - self.tensor(&format!("before.{name}"))).unwrap();
        let mut off = self.off(&after, got);
        if let Some(unclear) = self.tensors.get(&format!("unclear.{name}")) {
            let clear = unclear.to_dtype(DType::F32).unwrap().affine(-1.0, 1.0).unwrap();
            off = (off * clear).unwrap();
        }
        self.check_within(tolerance, largest(&movement), &after, &off);
    }

    fn off(&self, name: &str, got: &Tensor) -> Tensor {
        let expected = self.tensor(name);
        assert_eq!(got.dims(), expected.dims(), "{} {name}", self.name);
        (got.to_device(expected.device()).unwrap() - expected).unwrap()
    }

    fn check_within(&self, tolerance: f64, scale: f64, name: &str, off: &Tensor) {
        let worst = largest(off);
        assert!(
            worst <= tolerance * scale,
            "{} {name}: off by {worst:.3e}, allowed {tolerance:.0e} of {scale:.3e}",
            self.name
        );
    }
}
