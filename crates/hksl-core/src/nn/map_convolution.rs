//! Single convolutions of maps, and their transposes.

use candle_core::{
    CpuStorage, CustomOp3, Device, Layout, Result as CandleResult, Shape, Tensor, bail,
};

use crate::kernels::{Engine, MapConvolution, Places, channel_sums};
use crate::nn::as_products::{Growing, Shrinking};
use crate::nn::{Activation, Start};
use crate::on_host::{cpu, numbers};
use crate::params::Builder;
use crate::{Error, Result};

/// What a convolution goes over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MapShape {
    /// Rows and columns of the larger map: a convolution's input, a transposed one's output.
    pub large: (usize, usize),
    /// Channels of the larger map.
    pub channels: usize,
    /// Channels of the smaller map.
    pub filters: usize,
    /// Side of the square kernel.
    pub side: usize,
    /// Points of the larger map from one of the smaller to the next.
    pub stride: usize,
}

impl MapShape {
    /// Rows and columns of the smaller map; 0 where the larger map is smaller than the kernel, which no layer has.
    ///
    /// ```
    /// use hksl_core::nn::MapShape;
    ///
    /// let shape = MapShape { large: (64, 84), channels: 3, filters: 32, side: 4, stride: 2 };
    /// assert_eq!(shape.small(), (31, 41));
    /// ```
    pub fn small(&self) -> (usize, usize) {
        self.on(&Engine::default()).small()
    }

    /// Operations of one image in one direction, two for each multiply-add.
    pub fn operations(&self) -> f64 {
        self.on(&Engine::default()).operations()
    }

    fn check(&self) -> Result<()> {
        let Self { large: (rows, columns), side, stride, .. } = *self;
        if stride == 0 || rows.min(columns) < side {
            let got = vec![rows, columns];
            let expected =
                format!("at least {side}×{side} for kernels of that size, in steps above 0");
            return Err(Error::Shape { what: "a convolution's larger map", got, expected });
        }
        Ok(())
    }

    fn on(&self, engine: &Engine) -> MapConvolution {
        let Self { large, channels, filters, side, stride } = *self;
        MapConvolution { kernels: engine.kernels, large, channels, filters, side, stride }
    }
}

/// Which way a layer goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Shrink,
    Grow,
}

/// A layer in either direction; the weight is `(F, C, k, k)` in both.
#[derive(Debug, Clone)]
struct Layer {
    shape: MapShape,
    direction: Direction,
    activation: Activation,
    weight: Tensor,
    bias: Tensor,
    engine: Engine,
}

impl Layer {
    fn new(
        builder: &mut Builder,
        shape: MapShape,
        direction: Direction,
        activation: Activation,
        starts: (Start, Start),
    ) -> Result<Self> {
        shape.check()?;
        let MapShape { channels, filters, side, .. } = shape;
        let outputs = if direction == Direction::Shrink { filters } else { channels };
        let weight = builder.parameter("weight", &[filters, channels, side, side], starts.0)?;
        let bias = builder.parameter("bias", &[outputs], starts.1)?;
        let engine = builder.engine().clone();
        Ok(Self { shape, direction, activation, weight, bias, engine })
    }

    fn forward(&self, maps: &Tensor) -> Result<Tensor> {
        if !maps.device().is_cpu() {
            return self.forward_by_product(maps);
        }
        let operation = Operation {
            shape: self.shape.on(&self.engine),
            direction: self.direction,
            activation: self.activation,
            engine: self.engine.clone(),
        };
        Ok(maps.contiguous()?.apply_op3(&self.weight, &self.bias, operation)?)
    }

    /// The same as a matrix product over all patches, for GPUs.
    fn forward_by_product(&self, maps: &Tensor) -> Result<Tensor> {
        let (Self { direction, activation, bias, .. }, maps) = (self, maps.contiguous()?);
        let MapShape { large, channels, side, stride, .. } = self.shape;
        let places = Places { maps: large, channels, side, step: stride };
        let matrix = self.weight.permute((0, 2, 3, 1))?.flatten_from(1)?;
        let activation = *activation;
        Ok(match direction {
            Direction::Shrink => maps.apply_op3(&matrix, bias, Shrinking { places, activation })?,
            Direction::Grow => maps.apply_op3(&matrix, bias, Growing { places, activation })?,
        })
    }
}

/// A convolution without padding, and an activation.
///
/// Parameters: `weight` (F, C, k, k), `bias` (F).
#[derive(Debug, Clone)]
pub struct Convolution(Layer);

impl Convolution {
    /// A convolution whose weight and bias start so.
    ///
    /// # Errors
    /// A kernel that does not fit, a size or stride of 0, a name that exists already.
    pub fn new(
        builder: &mut Builder,
        shape: MapShape,
        activation: Activation,
        starts: (Start, Start),
    ) -> Result<Self> {
        Layer::new(builder, shape, Direction::Shrink, activation, starts).map(Self)
    }

    /// # Shapes
    /// - `maps`: `(B, H, W, C)`
    /// - output: `(B, h, w, F)`
    pub fn forward(&self, maps: &Tensor) -> Result<Tensor> {
        self.0.forward(maps)
    }
}

/// A transposed convolution, from the smaller map to the larger, and an activation. Points of the larger map that no
/// kernel reaches hold the bias: PyTorch's output padding.
///
/// Parameters: `weight` (F, C, k, k), which PyTorch calls (in, out, k, k), `bias` (C).
///
/// ```
/// use candle_core::{Device, Tensor};
/// use hksl_core::nn::{Activation, MapShape, Start, TransposedConvolution};
/// use hksl_core::{Builder, Parameters, rng};
///
/// let (mut parameters, mut rng) = (Parameters::default(), rng::stream(1, "init"));
/// let start = hksl_core::nn::Initialisation::Uniform;
/// let mut builder = Builder::create(&mut parameters, &mut rng, start, &Device::Cpu);
/// let shape = MapShape { large: (2, 4), channels: 1, filters: 1, side: 2, stride: 2 };
/// let starts = (Start::Constant(2.0), Start::Constant(1.0));
/// let layer = TransposedConvolution::new(&mut builder, shape, Activation::None, starts)?;
/// let maps = Tensor::new(&[[[[3f32], [5.0]]]], &Device::Cpu)?;
/// let grown = layer.forward(&maps)?.flatten_all()?.to_vec1::<f32>()?;
/// assert_eq!(grown, [7., 7., 11., 11., 7., 7., 11., 11.]);
/// # Ok::<(), hksl_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TransposedConvolution(Layer);

impl TransposedConvolution {
    /// A transposed convolution whose weight and bias start so.
    ///
    /// # Errors
    /// A kernel that does not fit, a size or stride of 0, a name that exists already.
    pub fn new(
        builder: &mut Builder,
        shape: MapShape,
        activation: Activation,
        starts: (Start, Start),
    ) -> Result<Self> {
        Layer::new(builder, shape, Direction::Grow, activation, starts).map(Self)
    }

    /// # Shapes
    /// - `maps`: `(B, h, w, F)`
    /// - output: `(B, H, W, C)`
    pub fn forward(&self, maps: &Tensor) -> Result<Tensor> {
        self.0.forward(maps)
    }
}

struct Operation {
    shape: MapConvolution,
    direction: Direction,
    activation: Activation,
    engine: Engine,
}

impl Operation {
    /// Of one image: rows, columns and channels of what goes in and of what comes out.
    fn ends(&self) -> [(usize, usize, usize); 2] {
        let (MapConvolution { large, channels, filters, .. }, small) =
            (self.shape, self.shape.small());
        let (large, small) = ((large.0, large.1, channels), (small.0, small.1, filters));
        match self.direction {
            Direction::Shrink => [large, small],
            Direction::Grow => [small, large],
        }
    }
}

impl CustomOp3 for Operation {
    fn name(&self) -> &'static str {
        "map-convolution"
    }

    fn cpu_fwd(
        &self,
        maps: &CpuStorage,
        maps_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> CandleResult<(CpuStorage, Shape)> {
        let (batch, rows, columns, channels) = maps_layout.shape().dims4()?;
        let [input, output] = self.ends();
        if (rows, columns, channels) != input {
            bail!("a convolution of maps {input:?} was given maps {:?}", (rows, columns, channels));
        }
        let (maps, weight) = (numbers(maps, maps_layout)?, numbers(weight, weight_layout)?);
        let (bias, pool) = (Some(numbers(bias, bias_layout)?), &self.engine.pool);
        let mut result = match self.direction {
            Direction::Shrink => self.shape.shrink(pool, maps, weight, bias),
            Direction::Grow => self.shape.grow(pool, maps, weight, bias),
        };
        self.activation.apply(&mut result);
        Ok((CpuStorage::F32(result), (batch, output.0, output.1, output.2).into()))
    }

    fn bwd(
        &self,
        maps: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        output: &Tensor,
        gradient: &Tensor,
    ) -> CandleResult<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let gradient = gradient.contiguous()?;
        let (maps_storage, maps_layout) = maps.storage_and_layout();
        let (weight_storage, weight_layout) = weight.storage_and_layout();
        let (output_storage, output_layout) = output.storage_and_layout();
        let (gradient_storage, gradient_layout) = gradient.storage_and_layout();
        let gradient = numbers(cpu(&gradient_storage)?, gradient_layout)?;
        let before = self.activation.back(numbers(cpu(&output_storage)?, output_layout)?, gradient);
        let gradient = before.as_deref().unwrap_or(gradient);
        let inputs = numbers(cpu(&maps_storage)?, maps_layout)?;
        let weights = numbers(cpu(&weight_storage)?, weight_layout)?;
        let pool = &self.engine.pool;
        let towards_maps = maps.track_op().then(|| match self.direction {
            Direction::Shrink => self.shape.grow(pool, gradient, weights, None),
            Direction::Grow => self.shape.shrink(pool, gradient, weights, None),
        });
        let trained = weight.track_op();
        let towards_weight = trained.then(|| match self.direction {
            Direction::Shrink => self.shape.weight_gradient(pool, inputs, gradient),
            Direction::Grow => self.shape.weight_gradient(pool, gradient, inputs),
        });
        let towards_bias = trained.then(|| channel_sums(gradient, self.ends()[1].2));
        let tensor = |numbers, like: &Tensor| Tensor::from_vec(numbers, like.shape(), &Device::Cpu);
        Ok((
            towards_maps.map(|numbers| tensor(numbers, maps)).transpose()?,
            towards_weight.map(|numbers| tensor(numbers, weight)).transpose()?,
            towards_bias.map(|numbers| tensor(numbers, bias)).transpose()?,
        ))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Var;

    use super::*;
    use crate::nn::Initialisation;
    use crate::params::Parameters;
    use crate::rng::{standard_normal, stream};
    use crate::testing::{assert_close, device, gradients};

    /// What runs on a GPU, there or on the CPU, against the kernels: output and all gradients, in both directions, with
    /// every activation, with points that no kernel reaches, and with channels by one and by four.
    #[test]
    fn products_and_kernels_agree() {
        for (direction, activation, large, channels, filters) in [
            (Direction::Shrink, Activation::Elu, (11, 8), 3, 5),
            (Direction::Shrink, Activation::None, (9, 10), 4, 5),
            (Direction::Grow, Activation::Relu, (12, 9), 3, 5),
            (Direction::Grow, Activation::Elu, (10, 12), 8, 4),
        ] {
            let shape = MapShape { large, channels, filters, side: 3, stride: 2 };
            let build = |device: &Device| {
                let (mut parameters, mut rng) = (Parameters::default(), stream(3, "maps"));
                let start = Initialisation::Uniform;
                let mut builder = Builder::create(&mut parameters, &mut rng, start, device);
                let starts = (start.weight(27, 1.0), start.bias(27));
                let layer = Layer::new(&mut builder, shape, direction, activation, starts);
                (parameters, layer.unwrap())
            };
            let ((rows, columns), (height, width)) = (shape.small(), large);
            let dims = match direction {
                Direction::Shrink => [4, height, width, channels],
                Direction::Grow => [4, rows, columns, filters],
            };
            let maps = standard_normal(&mut stream(5, "maps"), &dims, &Device::Cpu).unwrap();
            let of = |device: &Device| Var::from_tensor(&maps.to_device(device).unwrap()).unwrap();
            let (maps, others) = (of(&Device::Cpu), of(&device()));
            let (parameters, layer) = build(&Device::Cpu);
            let kernels = layer.forward(&maps).unwrap();
            let (other_parameters, layer) = build(&device());
            let products = layer.forward_by_product(&others).unwrap();
            assert_close(&products, &kernels);
            let (kernels, products) = (gradients(&kernels), gradients(&products));
            assert_close(products.get(&others).unwrap(), kernels.get(&maps).unwrap());
            for ((_, parameter), (_, other)) in parameters.iter().zip(other_parameters.iter()) {
                assert_close(products.get(other).unwrap(), kernels.get(parameter).unwrap());
            }
            // Maps of another shape, as many numbers or not.
            let [a, b, c, d] = dims;
            for wrong in [[a, d, b, c], [2 * a, b / 2, c, d], [a, b, c, d + 1]] {
                let wrong = Tensor::zeros(&wrong[..], candle_core::DType::F32, &device()).unwrap();
                assert!(layer.forward_by_product(&wrong).is_err(), "{:?}", wrong.dims());
            }
        }
    }
}
