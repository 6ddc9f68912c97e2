//! Where each encoder looks (HKSL appendix, "Attention Maps"): the last convolution's output after its activation,
//! averaged over the feature maps.

use candle_core::Device;
use hksl_sac::{Agent, ReceptiveField};
use ndarray::{Array2, Array3, ArrayView2};

use crate::Result;
use crate::episodes::{Episode, unfit};

/// What one encoder attends to over an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Attention {
    /// The encoder's name.
    pub encoder: String,
    /// `(T+1, h, w)`: mean activation at each place, at each time.
    pub maps: Array3<f32>,
    /// What a place looks at.
    pub field: ReceptiveField,
}

impl Attention {
    /// The smallest and the largest number of all maps.
    pub fn range(&self) -> (f32, f32) {
        let numbers = self.maps.iter();
        numbers.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &number| {
            (low.min(number), high.max(number))
        })
    }
}

/// The attention of each encoder to each observation of an episode.
///
/// # Errors
/// Frames of another shape than the agent's.
pub fn attention(
    agent: &Agent,
    episode: &Episode,
    stack: usize,
    device: &Device,
) -> Result<Vec<Attention>> {
    struct Part {
        encoder: String,
        field: ReceptiveField,
        size: (usize, usize),
        maps: Vec<f32>,
    }
    let mut parts: Vec<Part> = Vec::new();
    episode.each_batch(stack, device, |observations| {
        for (index, of) in agent.networks().feature_maps(observations)?.into_iter().enumerate() {
            let mean = of.maps.mean(1)?;
            let (_, height, width) = mean.dims3()?;
            if index == parts.len() {
                let (encoder, field) = (of.encoder, of.field);
                parts.push(Part { encoder, field, size: (height, width), maps: Vec::new() });
            }
            parts[index].maps.extend(mean.flatten_all()?.to_vec1::<f32>()?);
        }
        Ok(())
    })?;
    parts
        .into_iter()
        .map(|Part { encoder, field, size: (height, width), maps }| {
            let maps = Array3::from_shape_vec((episode.len() + 1, height, width), maps)
                .map_err(|error| unfit("feature maps", &error))?;
            Ok(Attention { encoder, maps, field })
        })
        .collect()
}

/// A map `(h, w)` laid over the observation `(height, width)` that it was made from.
///
/// Each place of the map stands at the centre of the pixels that it looks at, which keep clear of the picture's edges;
/// between the centres it is interpolated, beyond the outermost ones continued. Stretched over the whole picture, as
/// is often done, it would be off by half the width of what a place looks at near the edges.
///
/// # Panics
/// If the map has no place.
pub fn overlay(
    map: ArrayView2<'_, f32>,
    field: ReceptiveField,
    (height, width): (usize, usize),
) -> Array2<f32> {
    let (rows, columns) = map.dim();
    let (vertical, horizontal) = (positions(rows, field, height), positions(columns, field, width));
    Array2::from_shape_fn((height, width), |(row, column)| {
        let ((top, bottom, down), (left, right, along)) = (vertical[row], horizontal[column]);
        let upper = map[(top, left)] * (1.0 - along) + map[(top, right)] * along;
        let lower = map[(bottom, left)] * (1.0 - along) + map[(bottom, right)] * along;
        upper * (1.0 - down) + lower * down
    })
}

/// For each pixel of a side, the two places around it and how far it is from the first to the second.
fn positions(places: usize, field: ReceptiveField, side: usize) -> Vec<(usize, usize, f32)> {
    let last = (places - 1) as f32;
    (0..side)
        .map(|pixel| {
            let place = (pixel as f32 + 0.5 - 0.5 * field.side as f32) / field.spacing as f32;
            let place = place.clamp(0.0, last);
            let first = place.floor();
            (first as usize, (first as usize + 1).min(places - 1), place - first)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn places_stand_where_they_look() {
        // Three places two pixels apart, each looking at three pixels: a side of seven.
        let map = array![[0.0, 4.0, 8.0]];
        let field = ReceptiveField { side: 3, spacing: 2 };
        let over = overlay(map.view(), field, (1, 7));
        assert_eq!(over, array![[0.0, 0.0, 2.0, 4.0, 6.0, 8.0, 8.0]]);
        // A pixel at the end that no place looks at moves nothing.
        let wider = overlay(map.view(), field, (1, 8));
        assert_eq!(wider, array![[0.0, 0.0, 2.0, 4.0, 6.0, 8.0, 8.0, 8.0]]);
        let tall = overlay(map.t(), field, (7, 2));
        assert_eq!(tall.column(1), over.row(0));
    }
}
