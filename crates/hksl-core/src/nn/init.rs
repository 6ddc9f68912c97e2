//! How weights start: seeded, on the host, in the order in which modules are built.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// The two initialisations that the paper's authors use, by task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Initialisation {
    /// Weights and biases uniform in ±1/√fan_in.
    Uniform,
    /// Weights with orthonormal rows (or columns), times √2 for convolutions; biases 0.
    Orthogonal,
}

impl Initialisation {
    /// How a weight with `fan_in` inputs a unit starts; `gain` scales the orthogonal one.
    pub fn weight(self, fan_in: usize, gain: f64) -> Start {
        match self {
            Self::Uniform => Start::Uniform { bound: 1.0 / (fan_in as f64).sqrt() },
            Self::Orthogonal => Start::Orthogonal { gain },
        }
    }

    /// How the bias of a unit with `fan_in` inputs starts.
    pub fn bias(self, fan_in: usize) -> Start {
        match self {
            Self::Uniform => Start::Uniform { bound: 1.0 / (fan_in as f64).sqrt() },
            Self::Orthogonal => Start::Constant(0.0),
        }
    }
}

/// How the numbers of one parameter start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// All the same.
    Constant(f64),
    /// Uniform in ±`bound`.
    Uniform {
        /// The largest magnitude.
        bound: f64,
    },
    /// The matrix `(first dimension, all others)` has orthonormal rows, or columns where there are
    /// fewer of them, times `gain`.
    Orthogonal {
        /// The length of each of those rows or columns.
        gain: f64,
    },
}

impl Start {
    /// The numbers of a parameter of this shape, row-major.
    pub(crate) fn numbers(self, shape: &[usize], rng: &mut ChaCha8Rng) -> Vec<f32> {
        let count = shape.iter().product();
        match self {
            Self::Constant(value) => vec![value as f32; count],
            Self::Uniform { bound } => {
                (0..count).map(|_| rng.random_range(-bound..=bound) as f32).collect()
            }
            Self::Orthogonal { gain } => {
                let rows = shape.first().copied().unwrap_or(1);
                orthogonal(rows, count / rows.max(1), gain, rng)
            }
        }
    }
}

/// A `(rows, columns)` matrix, row-major, uniformly distributed among the (semi-)orthogonal ones.
///
/// Gram-Schmidt on Gaussian vectors is the QR decomposition with a positive diagonal of R, which is what
/// makes the distribution uniform. Each vector is swept twice, so that rounding leaves nothing behind.
fn orthogonal(rows: usize, columns: usize, gain: f64, rng: &mut ChaCha8Rng) -> Vec<f32> {
    let (count, length) = (rows.min(columns), rows.max(columns));
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(count);
    while basis.len() < count {
        let mut vector: Vec<f64> = (0..length).map(|_| rng.sample(StandardNormal)).collect();
        for _ in 0..2 {
            for earlier in &basis {
                let overlap: f64 = earlier.iter().zip(&vector).map(|(a, b)| a * b).sum();
                vector.iter_mut().zip(earlier).for_each(|(x, e)| *x -= overlap * e);
            }
        }
        let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        // A vector that lies in the span of the others has measure zero; draw another.
        if norm > 1e-9 {
            vector.iter_mut().for_each(|x| *x /= norm);
            basis.push(vector);
        }
    }
    let mut matrix = vec![0f32; rows * columns];
    for (index, vector) in basis.iter().enumerate() {
        for (position, value) in vector.iter().enumerate() {
            let (row, column) = if rows <= columns { (index, position) } else { (position, index) };
            matrix[row * columns + column] = (gain * value) as f32;
        }
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::stream;

    #[test]
    fn orthogonal_rows_or_columns_are_orthonormal() {
        for (rows, columns) in [(5, 12), (12, 5), (7, 7)] {
            let gain = 2f64.sqrt();
            let matrix = orthogonal(rows, columns, gain, &mut stream(1, "init"));
            let count = rows.min(columns);
            let vector = |i: usize| -> Vec<f32> {
                if rows <= columns {
                    matrix[i * columns..(i + 1) * columns].to_vec()
                } else {
                    (0..rows).map(|row| matrix[row * columns + i]).collect()
                }
            };
            for i in 0..count {
                for j in 0..count {
                    let product: f32 = vector(i).iter().zip(vector(j)).map(|(a, b)| a * b).sum();
                    let expected = if i == j { 2.0 } else { 0.0 };
                    assert!(
                        (product - expected).abs() < 1e-5,
                        "{rows}x{columns} {i} {j} {product}"
                    );
                }
            }
        }
    }

    #[test]
    fn uniform_numbers_fill_their_range() {
        let start = Initialisation::Uniform.weight(25, 1.0);
        let numbers = start.numbers(&[40, 25], &mut stream(1, "init"));
        assert!(numbers.iter().all(|x| x.abs() <= 0.2));
        assert!(numbers.iter().any(|x| *x > 0.19) && numbers.iter().any(|x| *x < -0.19));
    }
}
