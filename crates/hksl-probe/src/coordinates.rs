//! Ground-truth coordinates for linear probes.

use hksl_envs::{ProbeTargets, ReadingSpec, Spec};
use ndarray::{Array2, Axis};

use crate::episodes::Episode;
use crate::{Error, Result};

/// Default horizons of tasks that the paper does not probe, agent steps.
const HORIZONS: &[usize] = &[1, 5, 10];
const AXES: [&str; 3] = ["x", "y", "z"];

/// Named coordinates of the ground truth.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coordinates {
    /// Their names: `cart.x`, or the reading's name if it has one component.
    pub names: Vec<String>,
    /// Their unit, if all have the same.
    pub unit: Option<String>,
    columns: Vec<usize>,
}

impl Coordinates {
    /// The coordinates that the paper predicts in this task. For Falling Pixels, which the paper does not probe, the agent's
    /// column.
    ///
    /// # Errors
    /// [`Error::NoCoordinates`] for another task that the paper does not probe.
    pub fn of_task(spec: &Spec) -> Result<Self> {
        let Some(targets) = targets(&spec.task) else {
            let all = all(spec);
            return Err(Error::NoCoordinates {
                task: spec.task.clone(),
                example: all.iter().take(2).cloned().collect::<Vec<_>>().join(","),
                readings: spec
                    .readings
                    .iter()
                    .map(|reading| reading.name.clone().into_owned())
                    .collect(),
            });
        };
        Self::named(spec, targets.coordinates)
    }

    /// The coordinates with these names, such as `cart.x`. The name of a reading selects all its components.
    ///
    /// # Errors
    /// [`Error::UnknownCoordinate`] with all valid names.
    pub fn named(spec: &Spec, names: &[impl AsRef<str>]) -> Result<Self> {
        let all = all(spec);
        let mut columns = Vec::new();
        for name in names.iter().map(AsRef::as_ref) {
            let belongs = |of: &str| {
                of == name || of.strip_prefix(name).is_some_and(|rest| rest.starts_with('.'))
            };
            let before = columns.len();
            columns.extend(all.iter().enumerate().filter(|(_, of)| belongs(of)).map(|(i, _)| i));
            if columns.len() == before {
                let (task, name) = (spec.task.clone(), name.to_owned());
                return Err(Error::UnknownCoordinate { task, name, valid: all });
            }
        }
        let names = columns.iter().map(|&column| all[column].clone()).collect();
        let units = spec.readings.iter().flat_map(|of| std::iter::repeat_n(&*of.unit, of.len));
        let units: Vec<&str> = units.collect();
        let first = columns.first().map(|&column| units[column]).filter(|unit| !unit.is_empty());
        let unit = first.filter(|unit| columns.iter().all(|&column| units[column] == *unit));
        Ok(Self { names, unit: unit.map(str::to_owned), columns })
    }

    /// The values of the coordinates over an episode, `(T+1, M)`.
    pub fn values(&self, episode: &Episode) -> Array2<f64> {
        episode.readings.select(Axis(1), &self.columns)
    }
}

/// The paper's prediction horizons in this task, agent steps. For tasks that the paper does not probe: 1, 3, 5 for Falling
/// Pixels and 1, 5, 10 for others.
pub fn horizons(task: &str) -> &'static [usize] {
    targets(task).map_or(HORIZONS, |targets| targets.horizons)
}

fn targets(task: &str) -> Option<ProbeTargets> {
    hksl_envs::tasks().iter().find(|info| info.name == task)?.probe
}

/// The names of all coordinates of the ground truth.
fn all(spec: &Spec) -> Vec<String> {
    let names = |reading: &ReadingSpec| -> Vec<String> {
        let name = &reading.name;
        match reading.len {
            1 => vec![name.clone().into_owned()],
            3 => AXES.iter().map(|axis| format!("{name}.{axis}")).collect(),
            len => (0..len).map(|index| format!("{name}.{index}")).collect(),
        }
    };
    spec.readings.iter().flat_map(names).collect()
}

#[cfg(test)]
mod tests {
    use hksl_envs::FrameShape;
    use ndarray::{Array4, array};

    use super::*;

    fn spec(task: &str) -> Spec {
        let reading = |name, len| ReadingSpec::new(name, "m", len);
        Spec {
            task: task.to_owned(),
            frame: FrameShape { channels: 1, height: 1, width: 1 },
            action_dims: 1,
            steps_per_episode: 1,
            readings: vec![reading("cart", 3), reading("pole", 3), reading("angle", 1)],
        }
    }

    #[test]
    fn finds_the_papers_coordinates_and_named_ones() {
        let spec = spec("cartpole-swingup");
        let episode = Episode {
            frames: Array4::zeros((1, 1, 1, 1)),
            actions: Array2::zeros((0, 1)),
            readings: array![[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]],
        };
        let paper = Coordinates::of_task(&spec).unwrap();
        assert_eq!(paper.names, ["cart.x", "pole.x", "pole.z"]);
        assert_eq!(paper.unit.as_deref(), Some("m"));
        assert_eq!(paper.values(&episode), array![[0.0, 3.0, 5.0]]);
        let own = Coordinates::named(&spec, &["angle", "cart"]).unwrap();
        assert_eq!(own.values(&episode), array![[6.0, 0.0, 1.0, 2.0]]);
    }

    #[test]
    fn errors_list_valid_names() {
        let message = Coordinates::of_task(&spec("finger-spin")).unwrap_err().to_string();
        assert!(message.contains("--coordinates cart.x,cart.y"), "{message}");
        for name in ["pol", "cart.w", ""] {
            let message = Coordinates::named(&spec("finger-spin"), &[name]).unwrap_err();
            assert!(message.to_string().contains("pole.x, pole.y, pole.z, angle"), "{message}");
        }
    }
}
