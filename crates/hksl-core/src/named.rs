//! Groups of named tensors in a saved state.

use std::collections::BTreeMap;

use candle_core::Tensor;

use crate::{Error, Result};

/// Renames each tensor to `{prefix}.{name}`.
pub fn prefixed(prefix: &str, tensors: BTreeMap<String, Tensor>) -> BTreeMap<String, Tensor> {
    tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)).collect()
}

/// The tensors named `{prefix}.{name}`, with the prefix removed.
pub fn under(tensors: &BTreeMap<String, Tensor>, prefix: &str) -> BTreeMap<String, Tensor> {
    let rest = |name: &str| name.strip_prefix(prefix)?.strip_prefix('.').map(str::to_owned);
    tensors.iter().filter_map(|(name, tensor)| Some((rest(name)?, tensor.clone()))).collect()
}

/// Removes and returns the tensors named `{prefix}.{name}`, with the prefix removed. [`expect_empty`] then reports tensors
/// that belong to no group.
///
/// ```
/// use std::collections::BTreeMap;
///
/// use candle_core::{Device, Tensor};
/// use hksl_core::named::{expect_empty, take};
///
/// let number = Tensor::new(&[1f32], &Device::Cpu)?;
/// let names = ["weights.a", "weights.b", "moment.a"];
/// let mut tensors = BTreeMap::from(names.map(|name| (name.to_owned(), number.clone())));
/// assert_eq!(take(&mut tensors, "weights").into_keys().collect::<Vec<_>>(), ["a", "b"]);
/// assert!(expect_empty(&tensors).unwrap_err().to_string().contains("moment.a"));
/// # Ok::<(), hksl_core::Error>(())
/// ```
pub fn take(tensors: &mut BTreeMap<String, Tensor>, prefix: &str) -> BTreeMap<String, Tensor> {
    let taken = under(tensors, prefix);
    tensors.retain(|name, _| !name.strip_prefix(prefix).is_some_and(|rest| rest.starts_with('.')));
    taken
}

/// Checks that no tensor is left after all groups are taken.
///
/// # Errors
/// [`Error::UnknownParameter`] with the name of the first tensor left.
pub fn expect_empty(tensors: &BTreeMap<String, Tensor>) -> Result<()> {
    match tensors.keys().next() {
        Some(name) => Err(Error::UnknownParameter(name.clone())),
        None => Ok(()),
    }
}

/// Removes and returns the counter of this name. A negative value counts as 0.
///
/// # Errors
/// [`Error::MissingParameter`]; a tensor that is not a counter.
pub fn take_count(tensors: &mut BTreeMap<String, Tensor>, name: &str) -> Result<u64> {
    let count = tensors.remove(name).ok_or_else(|| Error::MissingParameter(name.to_owned()))?;
    Ok(count.to_scalar::<i64>()?.max(0) as u64)
}
