//! Attention maps of encoders (HKSL appendix, "Attention Maps"): the output of the last convolution after its activation,
//! averaged over the filters.

use candle_core::Device;
use hksl_sac::{Agent, ReceptiveField};
use ndarray::{Array2, Array3, ArrayView2};

use crate::Result;
use crate::episodes::{Episode, unfit};

/// Attention maps of one encoder over an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Attention {
    /// The encoder's name.
    pub encoder: String,
    /// `(T+1, h, w)`: mean activation at each time and position.
    pub maps: Array3<f32>,
    /// Receptive field of a position.
    pub field: ReceptiveField,
}

impl Attention {
    /// Minimum and maximum of all maps.
    pub fn range(&self) -> (f32, f32) {
        let numbers = self.maps.iter();
        numbers.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &number| {
            (low.min(number), high.max(number))
        })
    }
}

/// Computes the attention maps of each encoder for each observation of an episode.
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

/// Upsamples a map `(h, w)` to the size `(height, width)` of its observation.
///
/// Each element of the map is placed at the centre of its receptive field. Values are interpolated between the centres and
/// constant beyond the outermost ones. Stretching the map over the whole image would misplace it near the edges by half a
/// receptive field.
///
/// # Panics
/// If the map is empty.
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

/// For each pixel along a side, the two map positions around it and the interpolation weight of the second.
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
    fn positions_are_receptive_field_centres() {
        // Three positions two pixels apart with receptive fields of three pixels: a side of seven.
        let map = array![[0.0, 4.0, 8.0]];
        let field = ReceptiveField { side: 3, spacing: 2 };
        let over = overlay(map.view(), field, (1, 7));
        assert_eq!(over, array![[0.0, 0.0, 2.0, 4.0, 6.0, 8.0, 8.0]]);
        // A last pixel outside all receptive fields changes nothing.
        let wider = overlay(map.view(), field, (1, 8));
        assert_eq!(wider, array![[0.0, 0.0, 2.0, 4.0, 6.0, 8.0, 8.0, 8.0]]);
        let tall = overlay(map.t(), field, (7, 2));
        assert_eq!(tall.column(1), over.row(0));
    }
}
