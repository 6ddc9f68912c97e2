//! Frames with the attention of each encoder.

use hksl_probe::attention::{Attention, overlay};
use hksl_probe::episodes::Episode;
use ndarray::{Array2, Array3, ArrayView3, Axis};

use super::canvas::Canvas;
use hksl_train::images::magnification;

/// Space around tiles; pixels.
const GAP: usize = 8;
/// Largest opacity of a map over a frame.
const STRENGTH: f32 = 0.75;

/// An episode with the attention maps of each encoder. Each encoder has one colour scale for the whole episode.
pub struct Sheet<'a> {
    episode: &'a Episode,
    stack: usize,
    levels: &'a [Attention],
    ranges: Vec<(f32, f32)>,
}

impl<'a> Sheet<'a> {
    /// A sheet of an episode whose observations are stacks of `stack` frames.
    pub fn new(episode: &'a Episode, stack: usize, levels: &'a [Attention]) -> Self {
        Self { episode, stack, levels, ranges: levels.iter().map(Attention::range).collect() }
    }

    /// Draws one time step: a row with the frames of the observation, oldest first, a row with the encoders' maps, and
    /// a row with the maps over the newest frame.
    pub fn draw(&self, time: usize) -> Array3<u8> {
        let (_, _, height, width) = self.episode.frames.dim();
        let scale = magnification(height, width);
        let (height, width) = (height * scale, width * scale);
        // Narrow frames still need room for their captions.
        let pitch = width.max(136) + GAP;
        let columns = self.stack.max(self.levels.len());
        let row = |index: usize| GAP + index * (Canvas::LINE + height + GAP);
        let mut canvas = Canvas::new(row(3), GAP + columns * pitch);
        let mut tile = |(line, column): (usize, usize), caption: &str, image: Array3<u8>| {
            let left = GAP + column * pitch;
            canvas.write((row(line), left), caption);
            canvas.put((row(line) + Canvas::LINE, left), magnified(image.view(), scale).view());
        };
        for position in 0..self.stack {
            let age = self.stack - 1 - position;
            let caption = if age == 0 { format!("t = {time}") } else { format!("t - {age}") };
            tile((0, position), &caption, self.frame(time.saturating_sub(age)));
        }
        for (index, level) in self.levels.iter().enumerate() {
            tile((1, index), &level.encoder, self.map(index, time));
            tile((2, index), &format!("{} on t", level.encoder), self.over(index, time));
        }
        canvas.into_pixels()
    }

    /// Draws one time step in one row: the newest frame, then each encoder's map over it.
    pub fn strip(&self, time: usize) -> Array3<u8> {
        let (_, _, height, width) = self.episode.frames.dim();
        let scale = magnification(height, width);
        let (tiles, pitch) = (1 + self.levels.len(), width * scale + GAP);
        let mut canvas = Canvas::new(height * scale, tiles * pitch - GAP);
        canvas.put((0, 0), magnified(self.frame(time).view(), scale).view());
        for index in 0..self.levels.len() {
            let over = magnified(self.over(index, time).view(), scale);
            canvas.put((0, (index + 1) * pitch), over.view());
        }
        canvas.into_pixels()
    }

    /// The frame of a time step as RGB.
    fn frame(&self, time: usize) -> Array3<u8> {
        let frame = self.episode.frame(time);
        let (channels, height, width) = frame.dim();
        Array3::from_shape_fn((3, height, width), |(channel, row, column)| {
            frame[(channel.min(channels - 1), row, column)]
        })
    }

    /// Activity of an encoder at each pixel, scaled to 0…1 over the whole episode.
    fn activity(&self, index: usize, time: usize) -> Array2<f32> {
        let (level, (low, high)) = (&self.levels[index], self.ranges[index]);
        let (_, _, height, width) = self.episode.frames.dim();
        let map = level.maps.index_axis(Axis(0), time);
        let span = if high > low { high - low } else { 1.0 };
        overlay(map, level.field, (height, width)).mapv(|value| (value - low) / span)
    }

    fn map(&self, index: usize, time: usize) -> Array3<u8> {
        let activity = self.activity(index, time);
        let (height, width) = activity.dim();
        Array3::from_shape_fn((3, height, width), |(channel, row, column)| {
            heat(activity[(row, column)])[channel] as u8
        })
    }

    fn over(&self, index: usize, time: usize) -> Array3<u8> {
        let activity = self.activity(index, time);
        let frame = self.frame(time);
        Array3::from_shape_fn(frame.dim(), |(channel, row, column)| {
            let grey = (0..3).map(|c| f32::from(frame[(c, row, column)])).sum::<f32>() / 3.0;
            let strength = STRENGTH * activity[(row, column)];
            let colour = heat(activity[(row, column)])[channel];
            (grey * (1.0 - strength) + colour * strength).round() as u8
        })
    }
}

/// Magnifies each pixel to a square.
fn magnified(image: ArrayView3<u8>, scale: usize) -> Array3<u8> {
    let (channels, height, width) = image.dim();
    Array3::from_shape_fn((channels, height * scale, width * scale), |(channel, row, column)| {
        image[(channel, row / scale, column / scale)]
    })
}

/// Colour map from black over red and yellow to white; lightness increases throughout, so that it also works in grey.
fn heat(share: f32) -> [f32; 3] {
    let share = 3.0 * share.clamp(0.0, 1.0);
    [share, share - 1.0, share - 2.0].map(|part| 255.0 * part.clamp(0.0, 1.0))
}
