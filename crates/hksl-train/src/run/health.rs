//! NaN and infinite values, and the post-mortem files about them.

use std::collections::BTreeMap;

use candle_core::Tensor;
use serde_json::json;

use super::error::Error;
use super::session::Session;
use crate::Result;

impl Session<'_> {
    /// Stops the run at a value that is not finite.
    pub(super) fn check_finite(&self, quantity: &str, value: f64) -> Result<()> {
        if value.is_finite() { Ok(()) } else { Err(self.post_mortem(quantity, value)) }
    }

    /// Stops the run at a tensor with a number that is not finite.
    pub(super) fn check_tensors(&self, tensors: &BTreeMap<String, Tensor>) -> Result<()> {
        for (name, tensor) in tensors.iter().filter(|(_, tensor)| tensor.dtype().is_float()) {
            // A sum is not finite if one of its terms is not, and is taken where the tensor lives.
            let sum = tensor.sum_all()?.to_dtype(candle_core::DType::F64)?.to_scalar::<f64>()?;
            if sum.is_finite() {
                continue;
            }
            let numbers =
                tensor.flatten_all()?.to_dtype(candle_core::DType::F64)?.to_vec1::<f64>()?;
            if let Some(value) = numbers.into_iter().find(|number| !number.is_finite()) {
                return Err(self.post_mortem(name, value));
            }
        }
        Ok(())
    }

    /// Converts an error of the agent; writes a post-mortem if a value is NaN or infinite.
    pub(super) fn diagnosed(&self, error: hksl_sac::Error) -> crate::Error {
        match error {
            hksl_sac::Error::Core(hksl_core::Error::GradientNotFinite(norm)) => {
                self.post_mortem("norm of the gradients", norm)
            }
            hksl_sac::Error::NotFinite { what, value } => self.post_mortem(what, value),
            error => error.into(),
        }
    }

    /// Writes `post-mortem.json` and the current weights, ignoring write errors.
    fn post_mortem(&self, quantity: &str, value: f64) -> crate::Error {
        let (folder, state) = (self.plan.folder.path(), &self.state);
        let path = folder.join("post-mortem.json");
        let weights = folder.join("post-mortem.safetensors");
        let known = json!({
            "quantity": quantity,
            "value": value.to_string(),
            "agent_step": state.agent_step,
            "environment_step": state.environment_step,
            "updates": state.updates,
            "episode_return_so_far": state.episode_return,
            "last_evaluation": state.last_evaluation,
            "means_since_the_last_line_of_metrics": state.window.clone().take(),
            "last_update": self.last_update.iter().map(|(name, value)| (name, value.to_string()))
                .collect::<BTreeMap<_, _>>(),
            "weights": "post-mortem.safetensors",
        });
        // The original error matters more than a failed write.
        let _ = std::fs::write(&path, format!("{known:#}\n"));
        let bytes = self.agent.networks().weights();
        if let Ok(bytes) = bytes.and_then(|weights| Ok(hksl_core::to_safetensors(&weights)?)) {
            let _ = std::fs::write(&weights, bytes);
        }
        Error::NotFinite {
            quantity: quantity.to_owned(),
            value,
            agent_step: state.agent_step,
            environment_step: state.environment_step,
            post_mortem: path,
        }
        .into()
    }
}
