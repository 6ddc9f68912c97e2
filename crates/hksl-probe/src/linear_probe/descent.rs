//! Fitting of the linear map with Adam.

use candle_core::{Device, Tensor};
use hksl_core::nn::{Initialisation, Linear};
use hksl_core::optim::Adam;
use hksl_core::{Builder, Parameters, rng};
use ndarray::{Array1, Array2, ArrayView2, Axis};
use rand::seq::SliceRandom;

use super::{Descent, LinearMap};
use crate::Result;

pub(super) fn fit(
    inputs: ArrayView2<'_, f64>,
    targets: ArrayView2<'_, f64>,
    settings: &Descent,
) -> Result<LinearMap> {
    let (rows, dims, outputs) = (inputs.nrows(), inputs.ncols(), targets.ncols());
    let mean = targets.mean_axis(Axis(0)).unwrap_or_default();
    let scale = targets.std_axis(Axis(0), 0.0).mapv(|std| if std > 0.0 { std } else { 1.0 });
    let wanted = (&targets - &mean) / &scale;

    let (mut parameters, mut init) =
        (Parameters::default(), rng::stream(settings.seed, "probe init"));
    let mut builder =
        Builder::create(&mut parameters, &mut init, Initialisation::Uniform, &Device::Cpu);
    let linear = Linear::new(&mut builder, dims, outputs)?;
    let mut adam = Adam::new(parameters.clone(), settings.learning_rate)?;
    let mut order: Vec<usize> = (0..rows).collect();
    let mut shuffle = rng::stream(settings.seed, "probe batches");
    for _ in 0..settings.epochs {
        order.shuffle(&mut shuffle);
        for batch in order.chunks(settings.batch_size.max(1)) {
            let x = tensor(inputs.select(Axis(0), batch))?;
            let y = tensor(wanted.select(Axis(0), batch))?;
            let loss = (linear.forward(&x)? - y)?.sqr()?.mean_all()?;
            adam.step(&loss.backward()?)?;
        }
    }
    let read = |name: &str, shape: (usize, usize)| -> Result<Array2<f64>> {
        let missing = || hksl_core::Error::MissingParameter(name.to_owned());
        let values = parameters.get(name).ok_or_else(missing)?.flatten_all()?.to_vec1::<f32>()?;
        Ok(Array2::from_shape_fn(shape, |(row, column)| f64::from(values[row * shape.1 + column])))
    };
    let weights = read("weight", (outputs, dims))?.reversed_axes() * &scale;
    let bias: Array1<f64> = read("bias", (1, outputs))?.row(0).to_owned();
    Ok(LinearMap { weights, intercept: bias * &scale + &mean })
}

fn tensor(values: Array2<f64>) -> Result<Tensor> {
    let shape = values.dim();
    let values: Vec<f32> = values.into_iter().map(|value| value as f32).collect();
    Ok(Tensor::from_vec(values, shape, &Device::Cpu)?)
}
