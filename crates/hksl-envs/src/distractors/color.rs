//! Random walk of the materials' colours. Each component walks independently, near its original value.

use serde::{Deserialize, Serialize};

use super::ColorSettings;
use crate::dmc::Draws;

/// Red, green and blue of every material, in the model's order.
pub(super) type Colors = Vec<[f64; 3]>;

/// The random walk of all materials' colours.
#[derive(Clone, Debug)]
pub(super) struct ColorWalk {
    settings: ColorSettings,
    /// Minimum and maximum of each component, in f32 like the model's colours.
    bounds: Vec<[(f64, f64); 3]>,
    current: Colors,
}

/// State of a walk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ColorState {
    current: Colors,
}

impl ColorWalk {
    /// Creates a walk around the model's original colours.
    pub(super) fn new(settings: ColorSettings, original: &[[f32; 3]]) -> Self {
        let delta = settings.max_delta as f32;
        let bound = |component: f32| {
            let within = |value: f32| f64::from(value.clamp(0.0, 1.0));
            (within(component - delta), within(component + delta))
        };
        let bounds = original.iter().map(|color| color.map(bound)).collect();
        let current = original.iter().map(|color| color.map(f64::from)).collect();
        Self { settings, bounds, current }
    }

    /// Starts an episode at uniformly random colours within the bounds.
    pub(super) fn restart(&mut self, draws: &mut dyn Draws) {
        self.each(|_, (low, high)| draws.uniform(low, high));
    }

    /// Takes one control step.
    pub(super) fn advance(&mut self, draws: &mut dyn Draws) {
        let deviation = self.settings.step_std;
        self.each(|value, (low, high)| {
            (value + deviation * draws.standard_normal()).clamp(low, high)
        });
    }

    fn each(&mut self, mut next: impl FnMut(f64, (f64, f64)) -> f64) {
        for (color, bounds) in self.current.iter_mut().zip(&self.bounds) {
            for (value, bounds) in color.iter_mut().zip(bounds) {
                *value = next(*value, *bounds);
            }
        }
    }

    /// The current colours.
    pub(super) fn current(&self) -> &Colors {
        &self.current
    }

    pub(super) fn state(&self) -> ColorState {
        ColorState { current: self.current.clone() }
    }

    /// Restores a state if its number of materials fits and all components are within their bounds.
    pub(super) fn restore(&mut self, state: ColorState) -> Result<(), String> {
        if state.current.len() != self.bounds.len() {
            let (got, expected) = (state.current.len(), self.bounds.len());
            return Err(format!("colours of {got} materials, expected {expected}"));
        }
        let inside = |(color, bounds): (&[f64; 3], &[(f64, f64); 3])| {
            color.iter().zip(bounds).all(|(value, (low, high))| (low..=high).contains(&value))
        };
        if !state.current.iter().zip(&self.bounds).all(inside) {
            let most = self.settings.max_delta;
            return Err(format!("colours further than {most} from the model's own"));
        }
        self.current = state.current;
        Ok(())
    }
}
