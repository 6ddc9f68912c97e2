//! Elementwise GRU gates, forward and backward.

/// Applies gates: `σ(gate) · value`.
pub(crate) fn apply_gate(gates: &[f32], values: &[f32]) -> Vec<f32> {
    gates.iter().zip(values).map(|(gate, value)| sigmoid(*gate) * value).collect()
}

/// The gradients of the gates followed by those of the values.
pub(crate) fn apply_gate_backward(gates: &[f32], values: &[f32], gradients: &[f32]) -> Vec<f32> {
    let mut result = vec![0.0; 2 * gates.len()];
    let (grad_gates, grad_values) = result.split_at_mut(gates.len());
    for (index, gradient) in gradients.iter().enumerate() {
        let open = sigmoid(gates[index]);
        grad_gates[index] = gradient * values[index] * open * (1.0 - open);
        grad_values[index] = gradient * open;
    }
    result
}

/// The GRU update `(1 − u) · old + u · tanh(candidate)` with `u = σ(gate)`.
pub(crate) fn gru_update(gates: &[f32], candidates: &[f32], old: &[f32]) -> Vec<f32> {
    let blend = |(gate, (candidate, old)): (&f32, (&f32, &f32))| {
        old + sigmoid(*gate) * (candidate.tanh() - old)
    };
    gates.iter().zip(candidates.iter().zip(old)).map(blend).collect()
}

/// The gradients of gates, candidates and old state, one after the other.
pub(crate) fn gru_update_backward(
    gates: &[f32],
    candidates: &[f32],
    old: &[f32],
    gradients: &[f32],
) -> Vec<f32> {
    let mut result = vec![0.0; 3 * gates.len()];
    let (grad_gates, rest) = result.split_at_mut(gates.len());
    let (grad_candidates, grad_old) = rest.split_at_mut(gates.len());
    for (index, gradient) in gradients.iter().enumerate() {
        let (open, new) = (sigmoid(gates[index]), candidates[index].tanh());
        grad_gates[index] = gradient * (new - old[index]) * open * (1.0 - open);
        grad_candidates[index] = gradient * open * (1.0 - new * new);
        grad_old[index] = gradient * (1.0 - open);
    }
    result
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}
