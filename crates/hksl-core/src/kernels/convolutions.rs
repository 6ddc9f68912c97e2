//! A stack of 3×3 convolutions with bias and ReLU, from u8 images to feature maps.
//!
//! A task takes a few images through all layers. The first layer, of any stride, is computed directly and scales
//! by 1/255 on the way, and its gradient towards the weight is a direct sum; none is computed towards the pixels. The
//! others have stride 1, and they and their gradients go through Winograd's F(4×4, 3×3) (Lavin & Gray, arXiv 1509.09308).

mod direct;
mod packed;
mod portable;
mod tasks;
pub(super) mod winograd;

use rayon::prelude::*;

use self::packed::Weights;
use self::tasks::{Backward, Forward};
use self::winograd::Paired;
use super::memory::zeros;
use super::{Block, Counter, Engine, Kernels};

/// Images in one task.
const IMAGES: usize = 8;
/// Numbers of the tasks' sums that are added up at a time.
const SUMMED: usize = 1 << 12;

/// The shape of a stack, and the instructions it runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Convolutions {
    pub(crate) kernels: Kernels,
    /// `C`, of the images.
    pub(crate) channels: usize,
    /// `H`, of the images.
    pub(crate) height: usize,
    /// `W`, of the images.
    pub(crate) width: usize,
    /// `F`, of every layer.
    pub(crate) filters: usize,
    /// Of the first layer.
    pub(crate) stride: usize,
    /// How many layers.
    pub(crate) layers: usize,
}

/// The side of the square kernels.
pub(crate) const KERNEL: usize = 3;
const TAPS: usize = KERNEL * KERNEL;

/// Rows or columns that a convolution leaves of `side`.
pub(crate) fn output_side(side: usize, stride: usize) -> usize {
    (side - KERNEL) / stride + 1
}

impl Convolutions {
    /// Rows and columns of layer `layer`'s output.
    fn size(&self, layer: usize) -> (usize, usize) {
        let side = |side: usize| output_side(side, self.stride) - 2 * layer;
        (side(self.height), side(self.width))
    }

    /// Rows and columns of the last layer's output.
    pub(crate) fn output_size(&self) -> (usize, usize) {
        self.size(self.layers - 1)
    }

    fn image_numbers(&self) -> usize {
        self.channels * self.height * self.width
    }

    fn output_numbers(&self) -> usize {
        let (height, width) = self.output_size();
        height * width * self.filters
    }

    /// Filters, rounded up to whole vectors.
    fn padded(&self) -> usize {
        self.filters.next_multiple_of(self.kernels.lanes())
    }

    /// Numbers of layer `layer`'s output, filters padded.
    fn map_numbers(&self, layer: usize) -> usize {
        let (height, width) = self.size(layer);
        height * width * self.padded()
    }

    /// Numbers of the maps between the layers.
    fn activation_numbers(&self) -> usize {
        (0..self.layers - 1).map(|layer| self.map_numbers(layer)).sum()
    }

    /// Where weight and bias of layer `layer` lie among all parameters.
    pub(super) fn parameters(
        &self,
        layer: usize,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let weights = |layer: usize| {
            let inputs = if layer == 0 { self.channels } else { self.filters };
            self.filters * inputs * TAPS
        };
        let start = (0..layer).map(|layer| weights(layer) + self.filters).sum::<usize>();
        let end = start + weights(layer);
        (start..end, end..end + self.filters)
    }

    /// How many parameters the stack has: of each layer its weight (F, C, 3, 3) and bias (F), in this order.
    pub(crate) fn parameter_count(&self) -> usize {
        self.parameters(self.layers - 1).1.end
    }

    /// Counts a forward pass of `images`.
    fn count_forward(&self, counter: &Counter, images: usize) {
        let (mut defined, mut executed) = (self.operations(0), self.operations(0));
        for layer in 1..self.layers {
            let (rows, columns) = self.size(layer);
            defined += self.operations(layer);
            executed += self.winograd_operations(rows, columns);
        }
        self.count(counter, images, defined, executed);
        counter.add_encoder_images(images);
    }

    /// Counts a backward pass of `images`: gradients of all weights, and of all inputs but the images.
    fn count_backward(&self, counter: &Counter, images: usize) {
        let (mut defined, mut executed) = (self.operations(0), self.operations(0));
        for layer in 1..self.layers {
            let (rows, columns) = self.size(layer);
            defined += 2 * self.operations(layer);
            executed += self.winograd_operations(rows, columns)
                + self.winograd_operations(rows + 2, columns + 2);
        }
        self.count(counter, images, defined, executed);
        counter.add_encoder_images(2 * images);
    }

    /// Operations of layer `layer` for one image by definition.
    fn operations(&self, layer: usize) -> usize {
        let (rows, columns) = self.size(layer);
        let inputs = if layer == 0 { self.channels } else { self.filters };
        2 * rows * columns * self.filters * inputs * TAPS
    }

    /// Operations of a Winograd convolution with this output size for one image.
    fn winograd_operations(&self, rows: usize, columns: usize) -> usize {
        2 * winograd::products(rows, columns) * self.filters * self.filters
    }

    /// Adds a pass of `images`. The portable kernels execute convolutions by their definition.
    fn count(&self, counter: &Counter, images: usize, defined: usize, winograd: usize) {
        let executed = if self.kernels == Kernels::portable() { defined } else { winograd };
        counter.add(images * defined, images * executed);
    }

    /// Runs the stack.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)`
    /// - `parameters`: as [`Self::parameter_count`] says
    /// - output: `(B, h, w, F)`; and, if `keep`, the maps between the layers as [`Self::gradient`] needs them
    pub(crate) fn forward(
        &self,
        images: &[u8],
        parameters: &[f32],
        Engine { pool, counter, .. }: &Engine,
        keep: bool,
    ) -> (Vec<f32>, Option<Block>) {
        let count = images.len() / self.image_numbers();
        self.count_forward(counter, count);
        let mut output = zeros(count * self.output_numbers());
        let weights = Weights::forward(self, parameters);
        let run = |images: &[u8], output: &mut [f32], maps: &mut [f32]| {
            let mut task = Forward { stack: self, weights: &weights, pool, images, output, maps };
            if self.kernels.run(&mut task).is_none() {
                portable::forward(self, parameters, images, task.output, task.maps);
            }
        };
        let numbers = self.activation_numbers();
        let mut kept = keep.then(|| pool.take(count * numbers));
        let tasks = output
            .par_chunks_mut(IMAGES * self.output_numbers())
            .zip(images.par_chunks(IMAGES * self.image_numbers()));
        match &mut kept {
            // A single layer has nothing between.
            Some(kept) if numbers > 0 => tasks
                .zip(kept.par_chunks_mut(IMAGES * numbers))
                .for_each(|((output, images), maps)| run(images, output, maps)),
            _ => tasks.for_each(|(output, images)| {
                let count = images.len() / self.image_numbers();
                run(images, output, &mut pool.take(count * numbers));
            }),
        }
        (output, kept)
    }

    /// The gradient towards the parameters, in their order.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)`
    /// - `maps`, `output`: from [`Self::forward`]
    /// - `gradient`: `(B, h, w, F)`
    pub(crate) fn gradient(
        &self,
        images: &[u8],
        parameters: &[f32],
        Engine { pool, counter, .. }: &Engine,
        maps: &[f32],
        output: &[f32],
        gradient: &[f32],
    ) -> Vec<f32> {
        let weights = Weights::backward(self, parameters);
        let count = images.len() / self.image_numbers();
        self.count_backward(counter, count);
        let paired: Vec<Paired> = (1..self.layers).map(|_| Paired::new(self.filters)).collect();
        let sums: Vec<Vec<f32>> = (0..count.div_ceil(IMAGES))
            .into_par_iter()
            .map(|task| {
                let part = |numbers: usize| {
                    task * IMAGES * numbers..((task + 1) * IMAGES).min(count) * numbers
                };
                let written = part(self.output_numbers());
                let task = Backward {
                    stack: self,
                    weights: &weights,
                    pool,
                    images: &images[part(self.image_numbers())],
                    maps: &maps[part(self.activation_numbers())],
                    output: &output[written.clone()],
                    gradient: &gradient[written],
                    paired: &paired,
                };
                self.kernels.run(&task).unwrap_or_else(|| {
                    let Backward { images, maps, output, gradient, .. } = task;
                    portable::gradient(self, parameters, images, maps, output, gradient)
                })
            })
            .collect();
        let mut total = vec![0f32; sums.first().map_or(0, Vec::len)];
        total.par_chunks_mut(SUMMED).enumerate().for_each(|(index, total)| {
            for sum in &sums {
                for (total, number) in total.iter_mut().zip(&sum[index * SUMMED..]) {
                    *total += number;
                }
            }
        });
        if self.kernels == Kernels::portable() {
            return total;
        }
        packed::unpack(self, &mut total, &paired)
    }
}
