//! A stack of 3×3 convolutions with bias and ReLU, from u8 images to feature maps.
//!
//! The stack runs image by image: the maps of one image stay in the cache from layer to layer. The first
//! layer, of any stride, is computed directly and scales by 1/255 on the way; the others have stride 1 and go
//! through Winograd's F(2×2, 3×3) (Lavin & Gray, arXiv 1509.09308), which needs 16 multiplications where the
//! direct form needs 36. Gradients are those of the same arithmetic; none is computed towards the pixels.

mod direct;
mod portable;
mod winograd;

use std::sync::{Arc, Mutex};

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::Kernels;

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

/// The maps between the layers of every image of a batch, as the gradient needs them; their memory goes back to
/// where it came from.
#[derive(Debug, Default)]
pub(crate) struct Activations {
    maps: Vec<f32>,
    pool: Pool,
}

impl Drop for Activations {
    fn drop(&mut self) {
        if let Ok(mut free) = self.pool.0.lock() {
            free.push(std::mem::take(&mut self.maps));
        }
    }
}

/// Memory of earlier [`Activations`], to be overwritten: the largest blocks of a learning step, which need not
/// be zeroed anew each time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pool(Arc<Mutex<Vec<Vec<f32>>>>);

impl Pool {
    fn take(&self, numbers: usize) -> Activations {
        let free = self.0.lock().ok().and_then(|mut free| free.pop());
        let mut maps = free.unwrap_or_default();
        maps.resize(numbers, 0.0);
        Activations { maps, pool: self.clone() }
    }
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

    /// Operations of one image, two for each multiply-add: in the first layer; in the others by their
    /// definition; and in the others as Winograd's form multiplies.
    ///
    /// `(C, H, W, F, stride, layers)`
    pub(crate) fn operations(
        (channels, height, width, filters, stride, layers): (
            usize,
            usize,
            usize,
            usize,
            usize,
            usize,
        ),
    ) -> (f64, f64, f64) {
        let kernels = Kernels::portable();
        let stack = Self { kernels, channels, height, width, filters, stride, layers };
        let (rows, columns) = stack.size(0);
        let first = 2 * rows * columns * filters * channels * TAPS;
        let (mut rest, mut executed) = (0, 0);
        for (rows, columns) in (1..layers).map(|layer| stack.size(layer)) {
            rest += 2 * rows * columns * filters * filters * TAPS;
            executed += 2 * winograd::products(rows, columns) * filters * filters;
        }
        (first as f64, rest as f64, executed as f64)
    }

    /// Runs the stack.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)`
    /// - `parameters`: as [`Self::parameter_count`] says
    /// - output: `(B, h, w, F)`; and the maps between, if there is memory to keep them in
    pub(crate) fn forward(
        &self,
        images: &[u8],
        parameters: &[f32],
        keep: Option<&Pool>,
    ) -> (Vec<f32>, Option<Activations>) {
        let count = images.len() / self.image_numbers();
        let mut output = vec![0f32; count * self.output_numbers()];
        let kept = if keep.is_some() { self.activation_numbers() } else { 0 };
        let mut activations = keep.map(|pool| pool.take(count * kept));
        let weights = Weights::new(self, parameters, false);
        // An empty slice for each task where nothing is kept.
        let mut parts: Vec<&mut [f32]> = match &mut activations {
            Some(activations) if kept > 0 => activations.maps.chunks_mut(IMAGES * kept).collect(),
            _ => (0..count.div_ceil(IMAGES)).map(|_| Default::default()).collect(),
        };
        output
            .par_chunks_mut(IMAGES * self.output_numbers())
            .zip(images.par_chunks(IMAGES * self.image_numbers()))
            .zip(parts.par_iter_mut())
            .for_each(|((output, images), activations)| {
                let mut task =
                    Forward { stack: self, weights: &weights, images, output, activations };
                if self.kernels.run(&mut task).is_none() {
                    portable::forward(self, parameters, images, task.output, task.activations);
                }
            });
        drop(parts);
        (output, activations)
    }

    /// The gradient towards the parameters, in their order.
    ///
    /// # Shapes
    /// - `images`: `(B, C, H, W)`
    /// - `output`, `gradient`: `(B, h, w, F)`
    pub(crate) fn gradient(
        &self,
        images: &[u8],
        parameters: &[f32],
        activations: &Activations,
        output: &[f32],
        gradient: &[f32],
    ) -> Vec<f32> {
        let weights = Weights::new(self, parameters, true);
        let count = images.len() / self.image_numbers();
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
                    images: &images[part(self.image_numbers())],
                    activations: &activations.maps[part(self.activation_numbers())],
                    output: &output[written.clone()],
                    gradient: &gradient[written],
                };
                self.kernels.run(&task).unwrap_or_else(|| {
                    let Backward { images, activations, output, gradient, .. } = task;
                    portable::gradient(self, parameters, images, activations, output, gradient)
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
        if self.kernels == Kernels::portable() { total } else { weights.unpack(self, &total) }
    }
}

/// Weights in the forms that the vector kernels read; empty for the portable ones.
struct Weights {
    first: Vec<f32>,
    rest: Vec<winograd::Weights>,
    biases: Vec<Vec<f32>>,
}

impl Weights {
    fn new(stack: &Convolutions, parameters: &[f32], with_gradient: bool) -> Self {
        if stack.kernels == Kernels::portable() {
            return Self { first: Vec::new(), rest: Vec::new(), biases: Vec::new() };
        }
        let (filters, padded) = (stack.filters, stack.padded());
        let part = |layer: usize| {
            let (weight, bias) = stack.parameters(layer);
            (&parameters[weight], &parameters[bias])
        };
        let first = direct::pack(part(0).0, stack.channels, filters, padded);
        let rest = (1..stack.layers)
            .into_par_iter()
            .map(|layer| winograd::Weights::new(part(layer).0, filters, padded, with_gradient))
            .collect();
        let biases = (0..stack.layers)
            .map(|layer| {
                let mut bias = part(layer).1.to_vec();
                bias.resize(padded, 0.0);
                bias
            })
            .collect();
        Self { first, rest, biases }
    }

    /// Where the sums of a task lie: for each layer the weight's, in its packed form, then the bias's.
    fn packed_sizes(&self, stack: &Convolutions) -> Vec<(usize, usize)> {
        let rest = self.rest.iter().map(|weights| weights.numbers());
        let sizes = std::iter::once(self.first.len()).chain(rest);
        sizes.map(|numbers| (numbers, stack.padded())).collect()
    }

    /// From the sums of packed gradients to the parameters' gradient.
    fn unpack(&self, stack: &Convolutions, sums: &[f32]) -> Vec<f32> {
        let mut gradient = Vec::with_capacity(stack.parameter_count());
        let mut at = 0;
        for (layer, (numbers, bias)) in self.packed_sizes(stack).into_iter().enumerate() {
            let weight = &sums[at..at + numbers];
            if layer == 0 {
                direct::unpack(
                    weight,
                    stack.channels,
                    stack.filters,
                    stack.padded(),
                    &mut gradient,
                );
            } else {
                winograd::unpack(weight, stack.filters, stack.padded(), &mut gradient);
            }
            at += numbers;
            gradient.extend_from_slice(&sums[at..at + stack.filters]);
            at += bias;
        }
        gradient
    }
}

struct Forward<'a, 'b> {
    stack: &'a Convolutions,
    weights: &'a Weights,
    images: &'a [u8],
    output: &'b mut [f32],
    activations: &'b mut [f32],
}

impl WithSimd for &mut Forward<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // As many sums as the registers hold: 16 registers with AVX2, 32 elsewhere.
        if S::F32_LANES == 8 { self.run::<S, 4>(simd) } else { self.run::<S, 8>(simd) }
    }
}

impl Forward<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const M: usize>(&mut self, simd: S) {
        let (stack, weights) = (self.stack, self.weights);
        let plan = direct::Plan::new(stack);
        let mut scratch = winograd::Scratch::new(stack);
        let mut planes = vec![0f32; stack.image_numbers()];
        let numbers: Vec<usize> = (0..stack.layers).map(|layer| stack.map_numbers(layer)).collect();
        let kept = stack.activation_numbers();
        let keep = !self.activations.is_empty();
        let mut own = vec![0f32; if keep { 0 } else { kept }];
        let exact = stack.padded() == stack.filters;
        let mut last = vec![0f32; if exact { 0 } else { numbers[stack.layers - 1] }];
        let images = self.images.chunks_exact(stack.image_numbers());
        for (index, (image, output)) in
            images.zip(self.output.chunks_exact_mut(stack.output_numbers())).enumerate()
        {
            let mut maps: &mut [f32] = if keep {
                &mut self.activations[index * kept..(index + 1) * kept]
            } else {
                &mut own
            };
            let mut targets: Vec<&mut [f32]> = Vec::with_capacity(stack.layers);
            for numbers in &numbers[..stack.layers - 1] {
                let (target, rest) = std::mem::take(&mut maps).split_at_mut(*numbers);
                maps = rest;
                targets.push(target);
            }
            targets.push(if exact { &mut *output } else { &mut last });
            direct::planes(image, &mut planes);
            let mut input: &[f32] = &[];
            for (layer, target) in targets.into_iter().enumerate() {
                let bias = &weights.biases[layer];
                if layer == 0 {
                    direct::forward::<S, M>(simd, &plan, &planes, &weights.first, bias, target);
                } else {
                    let size = stack.size(layer - 1);
                    let weights = &weights.rest[layer - 1];
                    winograd::forward::<S, M>(
                        simd,
                        size,
                        input,
                        weights,
                        bias,
                        target,
                        &mut scratch,
                    );
                }
                input = target;
            }
            if !exact {
                let padded = last.chunks_exact(stack.padded());
                for (output, padded) in output.chunks_exact_mut(stack.filters).zip(padded) {
                    output.copy_from_slice(&padded[..stack.filters]);
                }
            }
        }
    }
}

struct Backward<'a> {
    stack: &'a Convolutions,
    weights: &'a Weights,
    images: &'a [u8],
    activations: &'a [f32],
    output: &'a [f32],
    gradient: &'a [f32],
}

impl WithSimd for &Backward<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        if S::F32_LANES == 8 { self.run::<S, 4>(simd) } else { self.run::<S, 8>(simd) }
    }
}

impl Backward<'_> {
    /// The sums over this task's images, packed: for each layer the weight's, then the bias's.
    #[inline(always)]
    fn run<S: Simd, const M: usize>(&self, simd: S) -> Vec<f32> {
        let (stack, weights) = (self.stack, self.weights);
        let sizes = weights.packed_sizes(stack);
        let mut sums = vec![0f32; sizes.iter().map(|(weight, bias)| weight + bias).sum()];
        let plan = direct::Plan::new(stack);
        let mut scratch = winograd::Scratch::new(stack);
        let mut planes = vec![0f32; stack.image_numbers()];
        let largest = stack.map_numbers(0);
        let (mut gradient, mut below) = (vec![0f32; largest], vec![0f32; largest]);
        let (filters, padded) = (stack.filters, stack.padded());
        let kept = stack.activation_numbers();
        for (index, image) in self.images.chunks_exact(stack.image_numbers()).enumerate() {
            let part = index * stack.output_numbers()..(index + 1) * stack.output_numbers();
            let rows = self.gradient[part.clone()].chunks_exact(filters);
            let outputs = self.output[part].chunks_exact(filters);
            for ((target, row), output) in gradient.chunks_exact_mut(padded).zip(rows).zip(outputs)
            {
                for ((target, number), output) in target.iter_mut().zip(row).zip(output) {
                    *target = if *output > 0.0 { *number } else { 0.0 };
                }
            }
            let mut maps = &self.activations[index * kept..(index + 1) * kept];
            let mut end = sums.len();
            for layer in (1..stack.layers).rev() {
                let (weight, bias) = sizes[layer];
                let (weight_sum, bias_sum) = sums[end - weight - bias..end].split_at_mut(weight);
                end -= weight + bias;
                let size = stack.size(layer - 1);
                let numbers = stack.map_numbers(layer - 1);
                let input = &maps[maps.len() - numbers..];
                maps = &maps[..maps.len() - numbers];
                winograd::gradient::<S, M>(
                    simd,
                    size,
                    input,
                    &weights.rest[layer - 1],
                    &gradient[..stack.map_numbers(layer)],
                    &mut below[..numbers],
                    weight_sum,
                    bias_sum,
                    &mut scratch,
                );
                std::mem::swap(&mut gradient, &mut below);
            }
            direct::planes(image, &mut planes);
            let (weight_sum, bias_sum) = sums[..end].split_at_mut(sizes[0].0);
            let gradient = &gradient[..stack.map_numbers(0)];
            direct::gradient::<S, M>(simd, &plan, &planes, gradient, weight_sum, bias_sum);
        }
        sums
    }
}
