//! Silhouette score.

use ndarray::ArrayView2;

use crate::{Error, Result};

/// The mean silhouette (Rousseeuw 1987) of vectors `(B, D)` in groups: 1 for well separated groups, 0 for overlapping groups,
/// −1 for vectors in the wrong groups.
///
/// A vector's silhouette is `(b − a) / max(a, b)`, where `a` is its mean distance to the other vectors of its group and `b`
/// the minimal mean distance to another group. It is 0 for a group with one vector, and if `a` and `b` are 0.
///
/// ```
/// use hksl_probe::silhouette::silhouette;
/// use ndarray::array;
///
/// let vectors = array![[0.0, 0.0], [0.0, 1.0], [10.0, 0.0], [10.0, 1.0]];
/// assert!(silhouette(vectors.view(), &[0, 0, 1, 1])? > 0.89);
/// assert!(silhouette(vectors.view(), &[0, 1, 0, 1])? < 0.0);
/// # Ok::<(), hksl_probe::Error>(())
/// ```
///
/// # Errors
/// A number of group indices other than `B`, or fewer than two groups. Group indices start at 0, and memory use grows with
/// the largest index. Vectors with NaN or infinity give a result of NaN or infinity.
pub fn silhouette(vectors: ArrayView2<'_, f64>, groups: &[usize]) -> Result<f64> {
    let rows = vectors.nrows();
    let count = groups.iter().max().map_or(0, |last| last + 1);
    let mut sizes = vec![0usize; count];
    groups.iter().for_each(|&group| sizes[group] += 1);
    if groups.len() != rows || sizes.iter().filter(|&&size| size > 0).count() < 2 {
        return Err(Error::Shape {
            what: "groups of vectors",
            got: format!("{} labels of {count} groups for {rows} vectors", groups.len()),
            expected: "a label for each vector, two groups or more".to_owned(),
        });
    }
    let mut total = 0.0;
    for (row, &own) in groups.iter().enumerate() {
        let mut sums = vec![0.0; count];
        for (other, &group) in groups.iter().enumerate() {
            sums[group] += distance(vectors, row, other);
        }
        if sizes[own] < 2 {
            continue;
        }
        let a = sums[own] / (sizes[own] - 1) as f64;
        let others = (0..count).filter(|&group| group != own && sizes[group] > 0);
        let b = others.map(|group| sums[group] / sizes[group] as f64).fold(f64::INFINITY, f64::min);
        let larger = a.max(b);
        if larger > 0.0 {
            total += (b - a) / larger;
        }
    }
    Ok(total / rows as f64)
}

pub(crate) fn distance(vectors: ArrayView2<'_, f64>, one: usize, other: usize) -> f64 {
    let pairs = vectors.row(one).into_iter().zip(vectors.row(other));
    pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
