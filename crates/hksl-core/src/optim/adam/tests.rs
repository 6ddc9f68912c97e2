//! Compares Adam with its recursion, for moments in vectors and in tensors.

use candle_core::Var;

use super::*;
use crate::testing::assert_close_numbers;

fn one(value: f32) -> (Parameters, Var) {
    one_on(value, &Device::Cpu)
}

fn one_on(value: f32, device: &Device) -> (Parameters, Var) {
    let variable = Var::new(&[value], device).unwrap();
    let mut parameters = Parameters::default();
    parameters.insert("x", variable.clone()).unwrap();
    (parameters, variable)
}

/// Gradients in which `x` has the gradient `factor`.
fn slope(x: &Var, factor: f64) -> GradStore {
    (x.as_tensor() * factor).unwrap().sum_all().unwrap().backward().unwrap()
}

/// The first and second moment in a state of [`one`] parameter.
fn mean_and_square(state: &BTreeMap<String, Tensor>) -> [f32; 2] {
    ["x.mean", "x.square"].map(|name| state[name].reshape(1).unwrap().to_vec1::<f32>().unwrap()[0])
}

/// Compares the GPU code path, on a GPU or on the CPU, with the fused pass. A state saved between steps must be a copy.
#[test]
fn both_homes_of_moments_agree() {
    let config = AdamConfig { learning_rate: 0.1, epsilon: 1e-2, l2: 0.3, decay: 0.01 };
    let [host, device] = [false, true].map(|device| {
        let home = if device { crate::testing::device() } else { Device::Cpu };
        let (parameters, x) = one_on(1.0, &home);
        let mut adam = Adam::with(parameters, config).unwrap();
        if device {
            let moments = Tensor::zeros((2, 1), DType::F32, &home).unwrap();
            adam.moments.get_mut("x").unwrap().values = Values::Device(moments);
        }
        let mut numbers = Vec::new();
        let mut early = None;
        for _ in 0..5 {
            let gradients = x.sqr().unwrap().sum_all().unwrap().backward().unwrap();
            adam.step_clipped(&gradients, 0.5).unwrap();
            numbers.extend(x.to_vec1::<f32>().unwrap());
            early.get_or_insert_with(|| adam.state().unwrap());
        }
        numbers.extend([early.unwrap(), adam.state().unwrap()].iter().flat_map(mean_and_square));
        numbers
    });
    assert_close_numbers(&device, &host, 1e-6, "weights and moments");
    assert_ne!(host[5..7], host[7..9]);
}

/// Minimises x² and compares with the recursion in f64.
#[test]
fn matches_the_recursion() {
    let (parameters, x) = one(1.0);
    let mut adam = Adam::new(parameters, 0.1).unwrap();
    let (mut expected, mut m, mut v) = (1f64, 0f64, 0f64);
    for step in 1..=20 {
        adam.step(&x.sqr().unwrap().sum_all().unwrap().backward().unwrap()).unwrap();
        let g = 2.0 * expected;
        (m, v) = (0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g);
        let (m_hat, v_hat) = (m / (1.0 - 0.9f64.powi(step)), v / (1.0 - 0.999f64.powi(step)));
        expected -= 0.1 * m_hat / (v_hat.sqrt() + 1e-8);
        let got = f64::from(x.to_vec1::<f32>().unwrap()[0]);
        assert!((got - expected).abs() < 2e-6, "step {step}: {got} {expected}");
    }
}

/// Minimises x² with an L2 penalty, a large ε, weight decay and a gradient clipped to 0.5.
#[test]
fn matches_the_recursion_with_all_settings() {
    let (parameters, x) = one(1.0);
    let config = AdamConfig { learning_rate: 0.1, epsilon: 1e-2, l2: 0.3, decay: 0.01 };
    let mut adam = Adam::with(parameters, config).unwrap();
    let (mut expected, mut m, mut v) = (1f64, 0f64, 0f64);
    for step in 1..=5 {
        let gradients = x.sqr().unwrap().sum_all().unwrap().backward().unwrap();
        let norm = adam.step_clipped(&gradients, 0.5).unwrap();
        assert!((norm - 2.0 * expected.abs()).abs() < 1e-5);
        let g = (2.0 * expected).clamp(-0.5, 0.5) + 0.3 * expected;
        (m, v) = (0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g);
        let (m_hat, v_hat) = (m / (1.0 - 0.9f64.powi(step)), v / (1.0 - 0.999f64.powi(step)));
        expected = (expected - 0.1 * m_hat / (v_hat.sqrt() + 1e-2)) * 0.99;
        let got = f64::from(x.to_vec1::<f32>().unwrap()[0]);
        assert!((got - expected).abs() < 2e-6, "step {step}: {got} {expected}");
    }
}

/// A first moment that decays with zero gradients becomes 0, a subnormal second moment is 0, and the weight is bitwise
/// identical to that of plain arithmetic.
#[test]
fn no_moment_is_subnormal() {
    let (parameters, x) = one(1.0);
    let mut adam = Adam::new(parameters, 0.1).unwrap();
    let (mut plain, mut m, mut v) = (1f32, 0f32, 0f32);
    for step in 1..=1000 {
        let factor = if step == 1 { 1e-18 } else { 0.0 };
        adam.step(&slope(&x, factor)).unwrap();
        let g = factor as f32;
        (m, v) = (BETA1 * m + (1.0 - BETA1) * g, BETA2 * v + (1.0 - BETA2) * g * g);
        let correction = |beta: f32| 1.0 - f64::from(beta).powi(step);
        let rate = (0.1 / correction(BETA1)) as f32;
        plain -= rate * m / (v.sqrt() / correction(BETA2).sqrt() as f32 + 1e-8);
        let [mean, square] = mean_and_square(&adam.state().unwrap());
        assert!(!mean.is_subnormal() && !square.is_subnormal(), "step {step}: {mean} {square}");
        assert_eq!(x.to_vec1::<f32>().unwrap(), [plain], "step {step}");
    }
    assert!(m.is_subnormal() && v.is_subnormal(), "the test's own moments are: {m} {v}");
}

#[test]
fn a_gradient_of_nan_changes_nothing() {
    for factor in [f64::NAN, f64::INFINITY] {
        let (parameters, x) = one(1.0);
        let mut adam = Adam::new(parameters, 0.1).unwrap();
        let stepped = adam.step_clipped(&slope(&x, factor), 0.5);
        assert!(matches!(stepped, Err(Error::GradientNotFinite(_))), "{factor}");
        assert_eq!(x.to_vec1::<f32>().unwrap(), [1.0]);
        assert_eq!(adam.state().unwrap()["x.steps"].to_scalar::<u32>().unwrap(), 0);
    }
}

#[test]
fn skips_what_has_no_gradient() {
    let (parameters, x) = one(1.0);
    let mut adam = Adam::new(parameters, 0.1).unwrap();
    adam.step(&x.sqr().unwrap().sum_all().unwrap().backward().unwrap()).unwrap();
    let before = x.to_vec1::<f32>().unwrap();
    let other = Var::new(&[1f32], &Device::Cpu).unwrap();
    adam.step(&other.sum_all().unwrap().backward().unwrap()).unwrap();
    assert_eq!(x.to_vec1::<f32>().unwrap(), before);
    assert_eq!(adam.state().unwrap()["x.steps"].to_scalar::<u32>().unwrap(), 1);
}

#[test]
fn a_loaded_state_resumes_the_saved_one() {
    let (parameters, x) = one(1.0);
    let mut adam = Adam::new(parameters, 0.1).unwrap();
    let gradients = x.sqr().unwrap().sum_all().unwrap().backward().unwrap();
    adam.step(&gradients).unwrap();
    let (state, value) = (adam.state().unwrap(), x.to_vec1::<f32>().unwrap()[0]);
    adam.step(&gradients).unwrap();

    let (parameters, y) = one(value);
    let mut resumed = Adam::new(parameters, 0.1).unwrap();
    resumed.load(&state).unwrap();
    // The same gradient, for y.
    resumed.step(&slope(&y, 2.0)).unwrap();
    assert_eq!(x.to_vec1::<f32>().unwrap(), y.to_vec1::<f32>().unwrap());

    let mut foreign = state.clone();
    foreign.insert("z.mean".into(), Tensor::new(&[0f32], &Device::Cpu).unwrap());
    assert!(
        matches!(resumed.load(&foreign), Err(Error::UnknownParameter(name)) if name == "z.mean")
    );
    foreign.remove("z.mean");
    foreign.insert("x.foo".into(), Tensor::new(&[0f32], &Device::Cpu).unwrap());
    assert!(
        matches!(resumed.load(&foreign), Err(Error::UnknownParameter(name)) if name == "x.foo")
    );
    foreign.remove("x.square");
    assert!(matches!(resumed.load(&foreign), Err(Error::MissingParameter(_))));
}
