//! Named tensors in groups, as a saved state holds them.

use std::collections::BTreeMap;

use candle_core::Tensor;

use crate::{Error, Result};

/// The tensors, named `{prefix}.{name}`.
pub fn prefixed(prefix: &str, tensors: BTreeMap<String, Tensor>) -> BTreeMap<String, Tensor> {
    tensors.into_iter().map(|(name, tensor)| (format!("{prefix}.{name}"), tensor)).collect()
}

/// Those named `{prefix}.{name}`, by what follows the prefix.
pub fn under(tensors: &BTreeMap<String, Tensor>, prefix: &str) -> BTreeMap<String, Tensor> {
    let rest = |name: &str| name.strip_prefix(prefix)?.strip_prefix('.').map(str::to_owned);
    tensors.iter().filter_map(|(name, tensor)| Some((rest(name)?, tensor.clone()))).collect()
}

/// As [`under`], and takes them out, so that [`nothing_left`] can say what belongs to no group.
///
/// ```
/// use std::collections::BTreeMap;
///
/// use candle_core::{Device, Tensor};
/// use hksl_core::named::{nothing_left, take};
///
/// let number = Tensor::new(&[1f32], &Device::Cpu)?;
/// let names = ["weights.a", "weights.b", "moment.a"];
/// let mut tensors = BTreeMap::from(names.map(|name| (name.to_owned(), number.clone())));
/// assert_eq!(take(&mut tensors, "weights").into_keys().collect::<Vec<_>>(), ["a", "b"]);
/// assert!(nothing_left(&tensors).unwrap_err().to_string().contains("moment.a"));
/// # Ok::<(), hksl_core::Error>(())
/// ```
pub fn take(tensors: &mut BTreeMap<String, Tensor>, prefix: &str) -> BTreeMap<String, Tensor> {
    let taken = under(tensors, prefix);
    tensors.retain(|name, _| !name.strip_prefix(prefix).is_some_and(|rest| rest.starts_with('.')));
    taken
}

/// That no tensor belongs to no group.
///
/// # Errors
/// [`Error::UnknownParameter`] names the first that is left.
pub fn nothing_left(tensors: &BTreeMap<String, Tensor>) -> Result<()> {
    match tensors.keys().next() {
        Some(name) => Err(Error::UnknownParameter(name.clone())),
        None => Ok(()),
    }
}

/// Takes the count of this name out; a negative one is 0.
///
/// # Errors
/// [`Error::MissingParameter`]; a tensor that is no count.
pub fn take_count(tensors: &mut BTreeMap<String, Tensor>, name: &str) -> Result<u64> {
    let count = tensors.remove(name).ok_or_else(|| Error::MissingParameter(name.to_owned()))?;
    Ok(count.to_scalar::<i64>()?.max(0) as u64)
}
