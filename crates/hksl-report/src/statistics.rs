//! Statistics of evaluation scores over runs and tasks, defined as in rliable 1.2.0.
//!
//! [`Scores`] holds the scores of one method, by task and run. Statistics are aggregates ([`iqm`], [`mean`],
//! [`median`], [`optimality_gap`]), the comparison with another method ([`probability_of_improvement`]) and the
//! distribution of scores ([`performance_profile`], [`profile_of_means`]). A stratified [`Bootstrap`] gives confidence
//! intervals: [`aggregate_intervals`] and [`improvement_interval`] for these statistics, [`curve`] for an aggregate per
//! checkpoint, [`profile_intervals`] for a profile, [`interval`] for any other statistic.
//!
//! Definitions follow Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice"
//! ([arXiv:2108.13264](https://arxiv.org/abs/2108.13264), section 4), as implemented in rliable 1.2.0
//! ([github.com/google-research/rliable](https://github.com/google-research/rliable)); tests compare with its results.
//! Unlike in rliable, tasks may have different numbers of runs. Statistics over task means then weigh every task
//! equally, statistics over all runs weigh every run equally.
//!
//! ```
//! use hksl_report::statistics::{Aggregate, Bootstrap, Scores, aggregate_intervals};
//!
//! let scores = Scores::new([
//!     ("walker_walk", vec![0.61, 0.72, 0.58, 0.66, 0.70]),
//!     ("cheetah_run", vec![0.31, 0.28, 0.35, 0.22, 0.30]),
//! ])?;
//! let iqm = aggregate_intervals(&scores, &[Aggregate::Iqm], &Bootstrap::seeded(1, "hksl"))?[0];
//! assert!((iqm.point - 2.81 / 6.0).abs() < 1e-12);
//! assert!((iqm.low - 0.44).abs() < 0.005 && (iqm.high - 0.505).abs() < 0.005);
//! # Ok::<(), hksl_report::statistics::Error>(())
//! ```

mod aggregates;
mod bootstrap;
mod curves;
mod draws;
mod error;
mod improvement;
mod intervals;
mod percentiles;
mod profile;
mod ranked;
mod scores;

pub use aggregates::{Aggregate, iqm, mean, median, optimality_gap};
pub use bootstrap::{
    Bootstrap, CONFIDENCE, MOST_REPLICATES, PROFILE_REPLICATES, REPLICATES, Resampling,
};
pub use curves::curve;
pub use error::{Error, Result};
pub use improvement::{improvement_interval, probability_of_improvement};
pub use intervals::{Estimate, aggregate_intervals, interval};
pub use percentiles::percentile;
pub use profile::{ProfileOf, performance_profile, profile_intervals, profile_of_means};
pub use scores::Scores;
