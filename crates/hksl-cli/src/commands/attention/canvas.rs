//! An image to draw tiles and text on.

use std::convert::Infallible;

use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::iso_8859_1::FONT_8X13;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};
use ndarray::{Array3, ArrayView3, s};

/// An image `(3, H, W)`, initially white.
pub struct Canvas {
    pixels: Array3<u8>,
}

impl Canvas {
    /// Height of a line of text.
    pub const LINE: usize = 17;

    /// A canvas of this size, in pixels.
    pub fn new(height: usize, width: usize) -> Self {
        Self { pixels: Array3::from_elem((3, height, width), 255) }
    }

    /// Draws an image `(3, H, W)` with its upper left corner at this row and column.
    pub fn put(&mut self, (row, column): (usize, usize), image: ArrayView3<u8>) {
        let (_, height, width) = image.dim();
        self.pixels.slice_mut(s![.., row..row + height, column..column + width]).assign(&image);
    }

    /// Writes a line of black text with its upper left corner at this row and column, clipped at the edges.
    pub fn write(&mut self, (row, column): (usize, usize), text: &str) {
        let style = MonoTextStyle::new(&FONT_8X13, Rgb888::BLACK);
        let place = Point::new(column as i32, row as i32);
        // The error type is uninhabited.
        let Ok(_) = Text::with_baseline(text, place, style, Baseline::Top).draw(self);
    }

    /// The image.
    pub fn into_pixels(self) -> Array3<u8> {
        self.pixels
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        let (_, height, width) = self.pixels.dim();
        Size::new(width as u32, height as u32)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = Pixel<Rgb888>>,
    {
        let (_, height, width) = self.pixels.dim();
        for Pixel(Point { x, y }, colour) in pixels {
            if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
                let (row, column) = (y as usize, x as usize);
                let channels = [colour.r(), colour.g(), colour.b()];
                for (channel, value) in channels.into_iter().enumerate() {
                    self.pixels[(channel, row, column)] = value;
                }
            }
        }
        Ok(())
    }
}
