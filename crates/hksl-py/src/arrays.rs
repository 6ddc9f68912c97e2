//! NumPy's arrays as ndarray's, borrowed.

use ndarray::{ArrayView3, ArrayView4, ArrayViewD, CowArray, Ix3, Ix4, IxDyn};
use numpy::{
    PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::error::{Error, Result};

/// Borrows an array of these elements.
pub fn borrow<'py, T: numpy::Element>(
    what: &'static str,
    array: &Bound<'py, PyAny>,
    expected: impl FnOnce() -> String,
) -> Result<PyReadonlyArrayDyn<'py, T>> {
    match array.cast::<PyArrayDyn<T>>() {
        Ok(array) => Ok(array.try_readonly().map_err(|_| Error::Busy { what: "array" })?),
        Err(_) => {
            let (got, dtype) = match array.cast::<PyUntypedArray>() {
                Ok(array) => (array.shape().to_vec(), array.dtype().to_string()),
                Err(_) => (Vec::new(), array.get_type().qualname()?.to_string()),
            };
            Err(Error::Array { what, got, dtype, expected: expected() })
        }
    }
}

/// The order of axes in which stacked frames may arrive.
#[derive(Debug, Clone, Copy)]
pub struct Stacked {
    /// Frames in a stack, `S`.
    pub frames: usize,
    /// Channels, height and width of the stack: `[S·C, H, W]`.
    pub shape: [usize; 3],
}

impl Stacked {
    fn expected(&self, batch: &str) -> String {
        let Self { frames, shape: [stacked, height, width] } = *self;
        let channels = stacked / frames;
        format!(
            "uint8 observations of {frames} stacked frames, oldest first, {batch}{stacked}, {height}, {width}) or \
             {batch}{height}, {width}, {stacked}) or {batch}{frames}, {height}, {width}, {channels})"
        )
    }

    /// One observation, `(S·C, H, W)`, `(H, W, S·C)`, `(S, C, H, W)` or `(S, H, W, C)`; `C` may be left out where it is 1,
    /// and `S·C` as well. Only the first of these orders is not copied.
    pub fn one<'a>(&self, array: ArrayViewD<'a, u8>) -> Result<CowArray<'a, u8, Ix3>> {
        let view = self.ordered(array, &[], "(")?;
        view.into_dimensionality::<Ix3>().map_err(|_| self.refused("observation", &[], "("))
    }

    /// A batch of observations in one of these orders, with the batch's axis in front.
    pub fn batch<'a>(&self, array: ArrayViewD<'a, u8>) -> Result<CowArray<'a, u8, Ix4>> {
        let count = array.shape().first().copied().unwrap_or_default();
        let view = self.ordered(array, &[count], "(batch, ")?;
        view.into_dimensionality::<Ix4>().map_err(|_| self.refused("observations", &[], "(batch, "))
    }

    fn ordered<'a>(
        &self,
        array: ArrayViewD<'a, u8>,
        batch: &[usize],
        told: &str,
    ) -> Result<CowArray<'a, u8, IxDyn>> {
        let Self { frames, shape: [stacked, height, width] } = *self;
        let (channels, first) = (stacked / frames, batch.len());
        let what = if first == 0 { "observation" } else { "observations" };
        let shape = array.shape().to_vec();
        let is = |rest: &[usize]| shape == [batch, rest].concat();
        let whole = [batch, &[stacked, height, width]].concat();
        let order = |axes: &[usize]| -> Vec<usize> {
            (0..first).chain(axes.iter().map(|axis| first + axis)).collect()
        };
        let moved = if is(&[stacked, height, width]) {
            return Ok(array.into());
        } else if is(&[height, width, stacked]) {
            array.permuted_axes(order(&[2, 0, 1]))
        } else if is(&[frames, channels, height, width])
            || (channels == 1 && is(&[frames, height, width]))
            || (stacked == 1 && is(&[height, width]))
        {
            array
        } else if is(&[frames, height, width, channels]) {
            array.permuted_axes(order(&[0, 3, 1, 2]))
        } else {
            return Err(self.refused(what, &shape, told));
        };
        let flat: Vec<u8> = moved.iter().copied().collect();
        let array = ndarray::ArrayD::from_shape_vec(whole, flat);
        Ok(array.map_err(|_| self.refused(what, &shape, told))?.into())
    }

    fn refused(&self, what: &'static str, got: &[usize], batch: &str) -> Error {
        let (got, dtype, expected) = (got.to_vec(), "uint8".to_owned(), self.expected(batch));
        Error::Array { what, got, dtype, expected }
    }

    /// Borrows an observation and applies `of` to it.
    pub fn with_one<T: Send>(
        &self,
        array: &Bound<'_, PyAny>,
        of: impl FnOnce(ArrayView3<u8>) -> Result<T> + Send,
    ) -> Result<T> {
        let borrowed = borrow::<u8>("observation", array, || self.expected("("))?;
        let ordered = self.one(borrowed.as_array())?;
        let view = ordered.view();
        array.py().detach(|| of(view))
    }

    /// Borrows a batch of observations and applies `of` to it.
    pub fn with_batch<T: Send>(
        &self,
        array: &Bound<'_, PyAny>,
        of: impl FnOnce(ArrayView4<u8>) -> Result<T> + Send,
    ) -> Result<T> {
        let borrowed = borrow::<u8>("observations", array, || self.expected("(batch, "))?;
        let ordered = self.batch(borrowed.as_array())?;
        let view = ordered.view();
        array.py().detach(|| of(view))
    }
}
