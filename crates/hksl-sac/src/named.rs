//! Named tensors in groups, as a learner's state holds them.

use std::collections::BTreeMap;

use candle_core::Tensor;

/// The tensors, named `{prefix}.{name}`.
pub fn prefixed(prefix: &str, tensors: BTreeMap<String, Tensor>) -> BTreeMap<String, Tensor> {
    tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)).collect()
}

/// Those named `{prefix}.{name}`, by what follows the prefix.
pub fn under(tensors: &BTreeMap<String, Tensor>, prefix: &str) -> BTreeMap<String, Tensor> {
    let rest = |name: &str| name.strip_prefix(prefix)?.strip_prefix('.').map(str::to_owned);
    tensors.iter().filter_map(|(name, tensor)| Some((rest(name)?, tensor.clone()))).collect()
}
