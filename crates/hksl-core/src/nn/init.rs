//! Weight initialisation. Values are drawn on the host, in the order in which modules are created.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Initialisation scheme of a network: the two that the paper's authors use, depending on the task, and that of SAC-AE.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Initialisation {
    /// Weights and biases uniform in ±1/√fan_in (PyTorch's default).
    Uniform,
    /// Orthogonal weights, with gain √2 for convolutions; biases 0.
    Orthogonal,
    /// Orthogonal weights, with all elements of a convolution kernel except its centre 0 (SAC-AE, CURL, DBC).
    DeltaOrthogonal,
}

impl Initialisation {
    /// The initialiser of a weight with `fan_in` inputs per unit. `gain` scales orthogonal weights.
    pub fn weight(self, fan_in: usize, gain: f64) -> Initializer {
        match self {
            Self::Uniform => Initializer::Uniform { bound: 1.0 / (fan_in as f64).sqrt() },
            Self::Orthogonal => Initializer::Orthogonal { gain },
            Self::DeltaOrthogonal => Initializer::DeltaOrthogonal { gain },
        }
    }

    /// The initialiser of the bias of a unit with `fan_in` inputs.
    pub fn bias(self, fan_in: usize) -> Initializer {
        match self {
            Self::Uniform => Initializer::Uniform { bound: 1.0 / (fan_in as f64).sqrt() },
            Self::Orthogonal | Self::DeltaOrthogonal => Initializer::Constant(0.0),
        }
    }
}

/// Standard deviation of the standard normal distribution truncated to [−2, 2].
const TRUNCATED_STD: f64 = 0.879_625_661_034_239_8;

/// Distribution of the initial values of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Initializer {
    /// A constant.
    Constant(f64),
    /// Uniform in ±`bound`, which must be finite and not negative.
    Uniform {
        /// The largest magnitude.
        bound: f64,
    },
    /// Uniform in [0, 1).
    UnitUniform,
    /// Normal, truncated at two standard deviations of the untruncated distribution (±2.27 `std`).
    TruncatedNormal {
        /// Standard deviation of the truncated distribution.
        std: f64,
    },
    /// Orthonormal rows of the matrix `(first dimension, all others)`, or orthonormal columns if there are fewer columns
    /// than rows, times `gain`.
    Orthogonal {
        /// The length of each of those rows or columns.
        gain: f64,
    },
    /// For a convolution `(out, in, rows, columns)`: an orthogonal matrix at the centre of the kernels and 0 elsewhere.
    /// For a matrix: the same as [`Self::Orthogonal`].
    DeltaOrthogonal {
        /// The length of each of those rows or columns.
        gain: f64,
    },
}

impl Initializer {
    /// Draws the values of a parameter of this shape, row-major.
    pub(crate) fn values(self, shape: &[usize], rng: &mut ChaCha8Rng) -> Vec<f32> {
        let count = shape.iter().product();
        match self {
            Self::Constant(value) => vec![value as f32; count],
            Self::Uniform { bound } => {
                (0..count).map(|_| rng.random_range(-bound..=bound) as f32).collect()
            }
            Self::TruncatedNormal { std } => {
                let wide = std / TRUNCATED_STD;
                let draw = |_| loop {
                    let number: f64 = rng.sample(StandardNormal);
                    if number.abs() <= 2.0 {
                        return (wide * number) as f32;
                    }
                };
                (0..count).map(draw).collect()
            }
            Self::UnitUniform => (0..count).map(|_| rng.random_range(0f32..1.0)).collect(),
            Self::Orthogonal { gain } => {
                let rows = shape.first().copied().unwrap_or(1);
                orthogonal(rows, count / rows.max(1), gain, rng)
            }
            Self::DeltaOrthogonal { gain } => {
                let &[outputs, inputs, rows, columns] = shape else {
                    return Self::Orthogonal { gain }.values(shape, rng);
                };
                let (taps, centre) = (rows * columns, rows / 2 * columns + columns / 2);
                let mut numbers = vec![0f32; count];
                let centres = numbers.iter_mut().skip(centre).step_by(taps);
                for (number, value) in centres.zip(orthogonal(outputs, inputs, gain, rng)) {
                    *number = value;
                }
                numbers
            }
        }
    }
}

/// Draws a (semi-)orthogonal matrix `(rows, columns)` uniformly, row-major.
///
/// Gram-Schmidt on Gaussian vectors equals a QR decomposition with positive diagonal of R, which makes the distribution
/// uniform. Each vector is orthogonalised twice to remove rounding errors.
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
        // Redraw a vector that lies almost in the span of the others.
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
    fn delta_orthogonal_convolutions_are_their_centres() {
        let initializer = Initialisation::DeltaOrthogonal.weight(18, 2f64.sqrt());
        let numbers = initializer.values(&[4, 2, 3, 3], &mut stream(1, "init"));
        let matrix = orthogonal(4, 2, 2f64.sqrt(), &mut stream(1, "init"));
        for (index, number) in numbers.iter().enumerate() {
            let expected = if index % 9 == 4 { matrix[index / 9] } else { 0.0 };
            assert_eq!(*number, expected, "{index}");
        }
        let linear = initializer.values(&[3, 5], &mut stream(1, "init"));
        assert_eq!(linear, orthogonal(3, 5, 2f64.sqrt(), &mut stream(1, "init")));
    }

    #[test]
    fn truncated_numbers_have_their_deviation() {
        let numbers =
            Initializer::TruncatedNormal { std: 0.5 }.values(&[20_000], &mut stream(1, "init"));
        let most = 2.0 * 0.5 / TRUNCATED_STD as f32;
        assert!(
            numbers.iter().all(|x| x.abs() <= most) && numbers.iter().any(|x| *x > 0.95 * most)
        );
        let std = (numbers.iter().map(|x| x * x).sum::<f32>() / 20_000.0).sqrt();
        assert!((std - 0.5).abs() < 0.01, "{std}");
    }

    #[test]
    fn uniform_numbers_fill_their_range() {
        let initializer = Initialisation::Uniform.weight(25, 1.0);
        let numbers = initializer.values(&[40, 25], &mut stream(1, "init"));
        assert!(numbers.iter().all(|x| x.abs() <= 0.2));
        assert!(numbers.iter().any(|x| *x > 0.19) && numbers.iter().any(|x| *x < -0.19));
    }
}
