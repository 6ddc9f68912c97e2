//! Benchmarks of the CPU kernels of a learning step, at the sizes of the paper's agents:
//! `cargo bench -p hksl-core --bench kernels`. Throughput counts floating-point operations (convolutions by their
//! definition), or parameters for the optimiser and the moving average.
#![allow(clippy::unwrap_used, missing_docs)]

use std::hint::black_box;

use candle_core::{DType, Device, Tensor, Var};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use hksl_core::kernels::Kernels;
use hksl_core::nn::{
    Activation, ConvolutionShape, Initialisation, Initializer, Linear, PixelEncoder,
    PixelEncoderConfig, TransposedConvolution, pixel_error,
};
use hksl_core::optim::{Adam, MovingAverage};
use hksl_core::{Builder, Encoder, Parameters, rng};

const BATCH: usize = 128;

/// Creates a network with gradient and a view of the same weights without.
fn build<T>(kernels: Kernels, mut make: impl FnMut(&mut Builder) -> T) -> (Parameters, T, T) {
    let mut parameters = Parameters::with_kernels(kernels);
    let (mut random, device) = (rng::stream(1, "bench"), Device::Cpu);
    let start = Initialisation::Uniform;
    let trained = make(&mut Builder::create(&mut parameters, &mut random, start, &device));
    let frozen = make(&mut Builder::view(&parameters, &device));
    (parameters, trained, frozen)
}

/// The operations of `work`, as the kernels of modules with these parameters count them.
fn throughput<T>(parameters: &Parameters, work: impl FnOnce() -> T) -> Throughput {
    let before = parameters.operations();
    black_box(work());
    Throughput::Elements((parameters.operations() - before).defined)
}

fn encoders(criterion: &mut Criterion) {
    let config = PixelEncoderConfig { filters: 32, latent_dims: 50 };
    for (task, image) in [("9x84x84", [9, 84, 84]), ("3x35x15", [3, 35, 15])] {
        let [c, h, w] = image;
        let pixels: Vec<u8> =
            (0..BATCH * c * h * w).map(|index| (index * 31 % 256) as u8).collect();
        let images = Tensor::from_vec(pixels, (BATCH, c, h, w), &Device::Cpu).unwrap();
        let mut group = criterion.benchmark_group(format!("encoder {task}"));
        for kernels in Kernels::available().into_iter().filter(|&set| set != Kernels::portable()) {
            let (parameters, trained, frozen) =
                build(kernels, |builder| PixelEncoder::new(builder, image, config).unwrap());
            let forward = || frozen.forward(black_box(&images)).unwrap();
            group.throughput(throughput(&parameters, forward));
            group.bench_function(BenchmarkId::new("forward", kernels), |bencher| {
                bencher.iter(forward);
            });
            let both = || {
                let latents = trained.forward(black_box(&images)).unwrap();
                latents.sqr().unwrap().sum_all().unwrap().backward().unwrap()
            };
            group.throughput(throughput(&parameters, both));
            group.bench_function(BenchmarkId::new("forward and backward", kernels), |bencher| {
                bencher.iter(both);
            });
        }
    }
}

/// Training the transposed convolutions of DreamerV2's decoder on images: three of stride 1 and one of stride 2.
fn decoder(criterion: &mut Criterion) {
    let sides = [(37, 32, 1), (39, 32, 1), (41, 32, 1), (84, 9, 2)];
    let shapes = sides.map(|(side, channels, stride)| ConvolutionShape {
        input_size: (side, side),
        channels,
        filters: 32,
        side: 3,
        stride,
    });
    let maps = Var::rand(0f32, 1.0, (BATCH, 35, 35, 32), &Device::Cpu).unwrap();
    let pictures = Tensor::zeros((BATCH, 9, 84, 84), DType::U8, &Device::Cpu).unwrap();
    let mut group = criterion.benchmark_group("decoder 9x84x84");
    for kernels in Kernels::available().into_iter().filter(|&set| set != Kernels::portable()) {
        let (parameters, trained, frozen) = build(kernels, |builder| {
            let layer = |(index, shape): (usize, ConvolutionShape)| {
                let initializers =
                    (Initializer::Uniform { bound: 0.06 }, Initializer::Constant(0.0));
                let builder = &mut builder.under(index);
                let activation =
                    if shape.stride == 1 { Activation::Relu } else { Activation::None };
                TransposedConvolution::new(builder, shape, activation, initializers).unwrap()
            };
            shapes.into_iter().enumerate().map(layer).collect::<Vec<_>>()
        });
        let through = |layers: &[TransposedConvolution], maps: &Tensor| {
            layers.iter().fold(maps.clone(), |maps, layer| layer.forward(&maps).unwrap())
        };
        let detached = maps.as_detached_tensor();
        let forward = || through(&frozen, black_box(&detached));
        group.throughput(throughput(&parameters, forward));
        group.bench_function(BenchmarkId::new("forward", kernels), |bencher| bencher.iter(forward));
        let both = || {
            let drawn = through(&trained, black_box(&maps));
            pixel_error(&drawn, &pictures).unwrap().backward().unwrap()
        };
        group.throughput(throughput(&parameters, both));
        group.bench_function(BenchmarkId::new("forward and backward", kernels), |bencher| {
            bencher.iter(both);
        });
    }
}

fn linear_maps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("linear");
    for (inputs, outputs) in [(1024, 1024), (39200, 50), (51, 1024)] {
        let (parameters, trained, frozen) =
            build(Kernels::detect(), |builder| Linear::new(builder, inputs, outputs).unwrap());
        let x = Tensor::rand(-1f32, 1.0, (BATCH, inputs), &Device::Cpu).unwrap();
        let name = format!("{inputs} to {outputs}");
        let forward = || frozen.forward_relu(black_box(&x)).unwrap();
        group.throughput(throughput(&parameters, forward));
        group.bench_function(BenchmarkId::new("forward", &name), |bencher| bencher.iter(forward));
        let both = || {
            let y = trained.forward_relu(black_box(&x)).unwrap();
            y.sum_all().unwrap().backward().unwrap()
        };
        group.throughput(throughput(&parameters, both));
        group.bench_function(BenchmarkId::new("forward and weight gradient", &name), |bencher| {
            bencher.iter(both);
        });
    }
}

fn in_place(criterion: &mut Criterion) {
    let make = |builder: &mut Builder| {
        Linear::new(&mut builder.under("slow"), 1024, 1024).unwrap();
        Linear::new(&mut builder.under("fast"), 1024, 1024).unwrap()
    };
    let (parameters, trained, _) = build(Kernels::detect(), make);
    let x = Tensor::ones((BATCH, 1024), DType::F32, &Device::Cpu).unwrap();
    let gradients = trained.forward(&x).unwrap().sum_all().unwrap().backward().unwrap();
    let own = parameters.under("fast");
    let mut group = criterion.benchmark_group("in place");
    group.throughput(Throughput::Elements(own.elements() as u64));
    let mut adam = Adam::new(own, 1e-3).unwrap();
    group.bench_function("Adam", |bencher| bencher.iter(|| adam.step(&gradients).unwrap()));
    let average = MovingAverage::new(&parameters, "fast", "slow", 0.01).unwrap();
    group.bench_function("moving average", |bencher| bencher.iter(|| average.update().unwrap()));
}

criterion_group!(benches, encoders, decoder, linear_maps, in_place);
criterion_main!(benches);
