//! What a gated cell does to each number by itself, forward and backward.

/// `σ(gate) · value`.
pub(crate) fn gated(gates: &[f32], values: &[f32]) -> Vec<f32> {
    gates.iter().zip(values).map(|(gate, value)| sigmoid(*gate) * value).collect()
}

/// The gradients towards the gates and, after those, the values.
pub(crate) fn gated_back(gates: &[f32], values: &[f32], gradients: &[f32]) -> Vec<f32> {
    let mut result = vec![0.0; 2 * gates.len()];
    let (towards_gates, towards_values) = result.split_at_mut(gates.len());
    for (index, gradient) in gradients.iter().enumerate() {
        let open = sigmoid(gates[index]);
        towards_gates[index] = gradient * values[index] * open * (1.0 - open);
        towards_values[index] = gradient * open;
    }
    result
}

/// `(1 − u) · old + u · tanh(candidate)` with `u = σ(gate)`.
pub(crate) fn blended(gates: &[f32], candidates: &[f32], old: &[f32]) -> Vec<f32> {
    let blend = |(gate, (candidate, old)): (&f32, (&f32, &f32))| {
        old + sigmoid(*gate) * (candidate.tanh() - old)
    };
    gates.iter().zip(candidates.iter().zip(old)).map(blend).collect()
}

/// The gradients towards the gates and, after those, the candidates and the old.
pub(crate) fn blended_back(
    gates: &[f32],
    candidates: &[f32],
    old: &[f32],
    gradients: &[f32],
) -> Vec<f32> {
    let mut result = vec![0.0; 3 * gates.len()];
    let (towards_gates, rest) = result.split_at_mut(gates.len());
    let (towards_candidates, towards_old) = rest.split_at_mut(gates.len());
    for (index, gradient) in gradients.iter().enumerate() {
        let (open, new) = (sigmoid(gates[index]), candidates[index].tanh());
        towards_gates[index] = gradient * (new - old[index]) * open * (1.0 - open);
        towards_candidates[index] = gradient * open * (1.0 - new * new);
        towards_old[index] = gradient * (1.0 - open);
    }
    result
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}
