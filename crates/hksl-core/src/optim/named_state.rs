//! Saved states of several named optimisers.

use std::collections::BTreeMap;

use candle_core::Tensor;

use super::Adam;
use crate::Result;
use crate::named::{expect_empty, prefixed, take};

/// Copies all moments of these optimisers, named `{optimiser}.{parameter}.…`.
///
/// # Errors
/// Whatever the tensors report.
pub fn state_of<'a, N: AsRef<str>>(
    optimisers: impl IntoIterator<Item = (N, &'a Adam)>,
) -> Result<BTreeMap<String, Tensor>> {
    let mut state = BTreeMap::new();
    for (name, adam) in optimisers {
        state.extend(prefixed(name.as_ref(), adam.state()?));
    }
    Ok(state)
}

/// Restores all these optimisers from a state of [`state_of`].
///
/// # Errors
/// A tensor that is missing, unknown or of another shape. No optimiser changes in that case.
pub fn load_into<'a, N: AsRef<str>>(
    optimisers: impl IntoIterator<Item = (N, &'a mut Adam)>,
    mut state: BTreeMap<String, Tensor>,
) -> Result<()> {
    let mut read = Vec::new();
    for (name, adam) in optimisers {
        let moments = adam.read(&take(&mut state, name.as_ref()))?;
        read.push((adam, moments));
    }
    expect_empty(&state)?;
    for (adam, moments) in read {
        adam.set(moments);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;
    use crate::{Error, Parameters};

    fn adam() -> Adam {
        let mut parameters = Parameters::default();
        parameters.insert("x", Var::new(&[1f32], &Device::Cpu).unwrap()).unwrap();
        Adam::new(parameters, 0.1).unwrap()
    }

    /// If the second optimiser lacks a tensor or a tensor belongs to none, the first must not change either.
    #[test]
    fn loading_is_all_or_nothing() {
        let (mut a, mut b) = (adam(), adam());
        let state = state_of([("a", &a), ("b.0", &b)]).unwrap();
        let mut moved = state.clone();
        for name in ["a.x.steps", "b.0.x.steps"] {
            moved.insert(name.into(), Tensor::new(7u32, &Device::Cpu).unwrap());
        }
        let steps = |adam: &Adam| adam.state().unwrap()["x.steps"].to_scalar::<u32>().unwrap();
        let mut load = |state: &BTreeMap<String, Tensor>| {
            let loaded = load_into([("a", &mut a), ("b.0", &mut b)], state.clone());
            (loaded, steps(&a), steps(&b))
        };
        let mut lacking = moved.clone();
        lacking.remove("b.0.x.mean");
        assert!(matches!(load(&lacking), (Err(Error::MissingParameter(_)), 0, 0)));
        let mut more = moved.clone();
        more.insert("b.1.x.mean".into(), Tensor::new(&[0f32], &Device::Cpu).unwrap());
        assert!(matches!(load(&more), (Err(Error::UnknownParameter(_)), 0, 0)));
        assert!(matches!(load(&moved), (Ok(()), 7, 7)));
    }
}
