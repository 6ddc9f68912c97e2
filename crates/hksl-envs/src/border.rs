//! A black border around every frame.

use ndarray::{Array3, s};
use serde_json::Value;

use crate::environment::PhysicalState;
use crate::{Environment, Error, FrameShape, Spec, Step};

/// Adds a black border of `border` pixels on each side to the frames of an environment. A random shift by up to `border`
/// pixels then cuts off no part of the original frame.
pub struct Bordered<E> {
    inner: E,
    border: usize,
    spec: Spec,
}

impl<E: Environment> Bordered<E> {
    /// Wraps `inner`. A border of 0 changes nothing.
    pub fn new(inner: E, border: usize) -> Self {
        let mut spec = inner.spec().clone();
        let FrameShape { channels, height, width } = spec.frame;
        spec.frame =
            FrameShape { channels, height: height + 2 * border, width: width + 2 * border };
        Self { inner, border, spec }
    }
}

impl<E: Environment> Environment for Bordered<E> {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self) -> Result<(), Error> {
        self.inner.reset()
    }

    fn step(&mut self, action: &[f32]) -> Result<Step, Error> {
        self.inner.step(action)
    }

    fn frame(&mut self) -> Result<Array3<u8>, Error> {
        let frame = self.inner.frame()?;
        let mut canvas = Array3::zeros(self.spec.frame.dim());
        let (_, height, width) = frame.dim();
        let border = self.border;
        canvas.slice_mut(s![.., border..border + height, border..border + width]).assign(&frame);
        Ok(canvas)
    }

    fn readings(&self) -> Vec<Vec<f64>> {
        self.inner.readings()
    }

    fn physical_state(&self) -> Option<PhysicalState> {
        self.inner.physical_state()
    }

    fn snapshot(&self) -> Result<Value, Error> {
        self.inner.snapshot()
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.inner.restore(snapshot)
    }

    fn restores_episodes(&self) -> bool {
        self.inner.restores_episodes()
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::{FallingPixels, Settings};

    #[test]
    fn the_frame_is_at_the_centre_and_the_border_black() {
        let settings = Settings::new(5, 3, 20);
        let task = || FallingPixels::new(&settings, ChaCha8Rng::seed_from_u64(3)).unwrap();
        let (mut plain, mut bordered) = (task(), Bordered::new(task(), 2));
        plain.reset().unwrap();
        bordered.reset().unwrap();
        assert_eq!(bordered.spec().frame, FrameShape { channels: 1, height: 9, width: 7 });
        for action in [-1.0, 1.0, 1.0] {
            let (frame, canvas) = (plain.frame().unwrap(), bordered.frame().unwrap());
            assert_eq!(canvas.slice(s![.., 2..7, 2..5]), frame);
            let lit = |pixels: &Array3<u8>| pixels.iter().filter(|pixel| **pixel > 0).count();
            assert_eq!(lit(&canvas), lit(&frame));
            assert_eq!(plain.step(&[action]).unwrap(), bordered.step(&[action]).unwrap());
            assert_eq!(plain.readings(), bordered.readings());
        }
        let snapshot = plain.snapshot().unwrap();
        bordered.restore(&snapshot).unwrap();
        assert_eq!(bordered.snapshot().unwrap(), snapshot);
    }
}
