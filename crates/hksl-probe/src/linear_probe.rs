//! Linear probes: how well a linear map from an encoder's frozen latents predicts future positions (HKSL §5.4, figures 5
//! and 6).
//!
//! ```
//! use hksl_probe::linear_probe::{Example, Fit, probe};
//! use ndarray::{Array2, array};
//!
//! // One latent, and a coordinate that is twice its value one step later.
//! let latents = Array2::from_shape_fn((20, 1), |(time, _)| f64::from((time * time) as u32));
//! let coordinates = Array2::from_shape_fn((20, 1), |(time, _)| 2.0 * (time as f64 - 1.0).powi(2));
//! let example = Example { latents: latents.view(), coordinates: coordinates.view() };
//! let errors = probe(&[example], &[example], 1, &Fit::default())?;
//! assert!(errors.mean() < 1e-6 * errors.constant_mean());
//! # Ok::<(), hksl_probe::Error>(())
//! ```

mod descent;
mod ridge;

use ndarray::{Array1, Array2, ArrayView2, Axis, concatenate, s};

use crate::{Error, Result};

/// Method of fitting the linear map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fit {
    /// Ridge regression in closed form. The weight of the squared coefficients is `penalty` times the mean variance of the
    /// latents' components times the number of examples. The intercept is not penalised.
    Ridge {
        /// Relative penalty.
        penalty: f64,
    },
    /// Adam on batches, as in the paper's text, with standardised targets.
    GradientDescent(Descent),
}

/// Settings of [`Fit::GradientDescent`]. The paper does not state its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Descent {
    /// Adam's learning rate.
    pub learning_rate: f64,
    /// Epochs.
    pub epochs: usize,
    /// Batch size.
    pub batch_size: usize,
    /// Seed of the initial weights and of the batches.
    pub seed: u64,
}

impl Default for Fit {
    fn default() -> Self {
        Self::Ridge { penalty: 1e-6 }
    }
}

impl Default for Descent {
    fn default() -> Self {
        Self { learning_rate: 1e-3, epochs: 200, batch_size: 128, seed: 1 }
    }
}

/// Latents and coordinates of an episode.
#[derive(Debug, Clone, Copy)]
pub struct Example<'a> {
    /// `(T+1, Z)`.
    pub latents: ArrayView2<'a, f64>,
    /// `(T+1, M)`.
    pub coordinates: ArrayView2<'a, f64>,
}

/// The linear map `y = x W + b`.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearMap {
    /// `(Z, M)`.
    pub weights: Array2<f64>,
    /// `(M)`.
    pub intercept: Array1<f64>,
}

impl LinearMap {
    /// Fits `targets` `(B, M)` as a function of `inputs` `(B, Z)`.
    ///
    /// # Errors
    /// No rows, or different numbers of rows; [`Error::NotFinite`]; [`Error::Singular`] if the solution is not unique, which
    /// can happen for a penalty of at most 0.
    pub fn fit(
        inputs: ArrayView2<'_, f64>,
        targets: ArrayView2<'_, f64>,
        fit: &Fit,
    ) -> Result<Self> {
        if inputs.nrows() != targets.nrows() || inputs.nrows() == 0 {
            let got = format!("{} rows", inputs.nrows());
            let expected = format!("the targets' {}, at least 1", targets.nrows());
            return Err(Error::Shape { what: "inputs of a linear map", got, expected });
        }
        if inputs.iter().chain(&targets).any(|value| !value.is_finite()) {
            return Err(Error::NotFinite { what: "latents or coordinates" });
        }
        match fit {
            Fit::Ridge { penalty } => ridge::fit(inputs, targets, *penalty),
            Fit::GradientDescent(descent) => descent::fit(inputs, targets, descent),
        }
    }

    /// Predicts targets `(B, M)` for `inputs` `(B, Z)`.
    pub fn predict(&self, inputs: ArrayView2<'_, f64>) -> Array2<f64> {
        inputs.dot(&self.weights) + &self.intercept
    }
}

/// Prediction errors on the test episodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Mean squared error of each episode, averaged over steps and coordinates.
    pub by_episode: Vec<f64>,
    /// Mean squared error of each coordinate, with equal weight for each episode.
    pub by_coordinate: Vec<f64>,
    /// [`Self::by_episode`] of a baseline that always predicts the mean of the training targets.
    pub constant_by_episode: Vec<f64>,
}

impl Errors {
    /// Mean over the test episodes.
    pub fn mean(&self) -> f64 {
        mean(&self.by_episode)
    }

    /// Standard deviation over the test episodes (ddof 0).
    pub fn std(&self) -> f64 {
        std(&self.by_episode)
    }

    /// Mean error of the constant baseline over the test episodes.
    pub fn constant_mean(&self) -> f64 {
        mean(&self.constant_by_episode)
    }
}

/// Fits a linear map on the `train` episodes that predicts the coordinates `horizon` agent steps after each latent, and
/// evaluates it on the `test` episodes. The last `horizon` latents of an episode have no target.
///
/// # Errors
/// No episodes, a horizon longer than an episode, latents of different sizes; errors of [`LinearMap::fit`].
pub fn probe(
    train: &[Example<'_>],
    test: &[Example<'_>],
    horizon: usize,
    fit: &Fit,
) -> Result<Errors> {
    let (train, test) = (pairs(train, horizon)?, pairs(test, horizon)?);
    check_test(&train, &test)?;
    let joined = |pick: fn(&Pair<'_>) -> Array2<f64>| {
        let parts: Vec<_> = train.iter().map(pick).collect();
        let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
        concatenate(Axis(0), &views).map_err(|error| Error::Shape {
            what: "training episodes",
            got: error.to_string(),
            expected: "one or more of the same sizes".to_owned(),
        })
    };
    let inputs = joined(|(latents, _)| latents.to_owned())?;
    let targets = joined(|(_, coordinates)| coordinates.to_owned())?;
    let map = LinearMap::fit(inputs.view(), targets.view(), fit)?;
    let average = targets.mean_axis(Axis(0)).unwrap_or_default();
    let mut errors =
        Errors { by_episode: vec![], by_coordinate: vec![], constant_by_episode: vec![] };
    let mut coordinates = Array1::<f64>::zeros(targets.ncols());
    for (latents, wanted) in &test {
        let squares = (map.predict(*latents) - wanted).mapv(|error| error * error);
        let constant = (wanted - &average).mapv(|error| error * error);
        errors.by_episode.push(squares.mean().unwrap_or(f64::NAN));
        errors.constant_by_episode.push(constant.mean().unwrap_or(f64::NAN));
        coordinates += &squares.mean_axis(Axis(0)).unwrap_or_default();
    }
    errors.by_coordinate = (coordinates / test.len().max(1) as f64).to_vec();
    Ok(errors)
}

type Pair<'a> = (ArrayView2<'a, f64>, ArrayView2<'a, f64>);

/// Pairs each latent with the coordinates `horizon` steps later.
fn pairs<'a>(examples: &[Example<'a>], horizon: usize) -> Result<Vec<Pair<'a>>> {
    let pair = |example: &Example<'a>| {
        let rows = example.latents.nrows();
        if horizon >= rows || example.coordinates.nrows() != rows {
            return Err(Error::Shape {
                what: "an episode's observations",
                got: format!("{rows} latents and {} coordinates", example.coordinates.nrows()),
                expected: format!("as many of both, more than the horizon of {horizon}"),
            });
        }
        let Example { latents, coordinates } = *example;
        Ok((
            latents.slice_move(s![..rows - horizon, ..]),
            coordinates.slice_move(s![horizon.., ..]),
        ))
    };
    examples.iter().map(pair).collect()
}

/// Checks that test episodes exist, have the dimensions of the training episodes and are finite. [`LinearMap::fit`] checks
/// the training episodes.
fn check_test(train: &[Pair<'_>], test: &[Pair<'_>]) -> Result<()> {
    let widths = |(latents, coordinates): &Pair<'_>| (latents.ncols(), coordinates.ncols());
    let expected = train.first().map(widths);
    let found = test.iter().map(widths).find(|found| Some(*found) != expected);
    if test.is_empty() || found.is_some() {
        return Err(Error::Shape {
            what: "test episodes",
            got: found.map_or("none".to_owned(), |(latents, coordinates)| {
                format!("{latents} latents and {coordinates} coordinates")
            }),
            expected: "one or more, of the training episodes' sizes".to_owned(),
        });
    }
    let mut numbers =
        test.iter().flat_map(|(latents, coordinates)| latents.iter().chain(coordinates));
    if numbers.any(|number| !number.is_finite()) {
        return Err(Error::NotFinite { what: "latents or coordinates" });
    }
    Ok(())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn std(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}
