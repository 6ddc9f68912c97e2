//! Principal component analysis.

use nalgebra::{DMatrix, SVD};
use ndarray::{Array1, Array2, ArrayView2, Axis};

use crate::{Error, Result};

/// Principal components of vectors.
#[derive(Debug, Clone, PartialEq)]
pub struct Pca {
    /// `(D)`: mean of the vectors.
    pub mean: Array1<f64>,
    /// `(components, D)`: unit vectors, ordered by decreasing variance. The element with the largest absolute value is
    /// positive.
    pub components: Array2<f64>,
    /// `(components)`: variance along each component (ddof 1).
    pub explained_variance: Array1<f64>,
    /// `(components)`: fraction of the total variance; 0 if the total variance is 0.
    pub explained_variance_ratio: Array1<f64>,
    /// `(B, components)`: projections of the vectors.
    pub projections: Array2<f64>,
}

/// Computes the first `components` principal components of `vectors` `(B, D)`.
///
/// # Errors
/// Fewer vectors or dimensions than components, fewer than two vectors, vectors without dimensions;
/// [`Error::NotFinite`]; no convergence.
pub fn pca(vectors: ArrayView2<'_, f64>, components: usize) -> Result<Pca> {
    let (rows, dims) = vectors.dim();
    if rows < 2 || dims == 0 || components > rows.min(dims) {
        return Err(Error::Shape {
            what: "vectors of a principal component analysis",
            got: format!("{rows} vectors of {dims} numbers"),
            expected: format!("at least 2 vectors, and {} of both", components.max(1)),
        });
    }
    if vectors.iter().any(|value| !value.is_finite()) {
        return Err(Error::NotFinite { what: "the vectors to project" });
    }
    let mean = vectors.mean_axis(Axis(0)).unwrap_or_default();
    let centred = &vectors - &mean;
    let matrix = DMatrix::from_fn(rows, dims, |row, column| centred[(row, column)]);
    let failed = || Error::Shape {
        what: "singular values of the vectors",
        got: "no convergence".to_owned(),
        expected: "finite vectors".to_owned(),
    };
    let svd = SVD::try_new(matrix, false, true, f64::EPSILON, 10_000).ok_or_else(failed)?;
    let right = svd.v_t.ok_or_else(failed)?;
    let total: f64 = svd.singular_values.iter().map(|value| value * value).sum();
    let mut directions = Array2::from_shape_fn((components, dims), |index| right[index]);
    for mut direction in directions.rows_mut() {
        let largest = direction
            .iter()
            .copied()
            .fold(0f64, |largest, value| if value.abs() > largest.abs() { value } else { largest });
        if largest < 0.0 {
            direction.mapv_inplace(|value| -value);
        }
    }
    let squares: Array1<f64> =
        (0..components).map(|index| svd.singular_values[index].powi(2)).collect();
    let ratio = squares.mapv(|square| if total > 0.0 { square / total } else { 0.0 });
    let projections = centred.dot(&directions.t());
    Ok(Pca {
        mean,
        components: directions,
        explained_variance: squares / (rows - 1) as f64,
        explained_variance_ratio: ratio,
        projections,
    })
}
