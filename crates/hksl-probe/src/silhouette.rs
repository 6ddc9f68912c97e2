//! How separate groups of vectors are.

use ndarray::ArrayView2;

use crate::{Error, Result};

/// The mean silhouette (Rousseeuw 1987) of vectors `(B, D)` in groups: 1 where every vector is much nearer to its own
/// group than to any other, 0 where groups overlap, −1 where vectors are in the wrong group. With `a` a vector's mean
/// distance to the others of its group and `b` the smallest mean distance to another group, its own is
/// `(b − a) / max(a, b)`; it is 0 for the only vector of a group, and where both are 0.
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
/// Not one group a vector, or fewer than two groups. Groups are counted from 0, and memory goes with the largest; vectors
/// that are not finite give a value that is not.
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
