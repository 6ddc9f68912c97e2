//! Layer normalisation of rows, forward and backward, as the GPU kernels compute it.

/// Normalises every row: `(x − mean) / √(variance + ε) · weight + bias`.
pub(crate) fn layer_norm(x: &[f32], weight: &[f32], bias: &[f32], epsilon: f32) -> Vec<f32> {
    let mut result = Vec::with_capacity(x.len());
    for row in x.chunks_exact(weight.len()) {
        let (mean, scale) = moments(row, epsilon);
        let affine = weight.iter().zip(bias);
        result.extend(row.iter().zip(affine).map(|(x, (w, b))| (x - mean) * scale * w + b));
    }
    result
}

/// The gradient of `x`, followed by the gradient of the weight before the sum over rows.
pub(crate) fn layer_norm_backward(
    x: &[f32],
    weight: &[f32],
    gradient: &[f32],
    epsilon: f32,
) -> Vec<f32> {
    let (size, mut result) = (weight.len(), vec![0.0; 2 * x.len()]);
    let (grad_x, grad_weight) = result.split_at_mut(x.len());
    let rows = x.chunks_exact(size).zip(gradient.chunks_exact(size));
    let results = grad_x.chunks_exact_mut(size).zip(grad_weight.chunks_exact_mut(size));
    for ((row, gradient), (grad_x, grad_weight)) in rows.zip(results) {
        let (mean, scale) = moments(row, epsilon);
        let (mut sum, mut product) = (0.0, 0.0);
        for ((x, gradient), weight) in row.iter().zip(gradient).zip(weight) {
            sum += gradient * weight;
            product += gradient * weight * (x - mean) * scale;
        }
        let (sum, product) = (sum / size as f32, product / size as f32);
        for index in 0..size {
            let normed = (row[index] - mean) * scale;
            grad_x[index] = scale * (gradient[index] * weight[index] - sum - normed * product);
            grad_weight[index] = gradient[index] * normed;
        }
    }
    result
}

/// Mean and inverse standard deviation of a row.
fn moments(row: &[f32], epsilon: f32) -> (f32, f32) {
    let mean = row.iter().sum::<f32>() / row.len() as f32;
    let variance = row.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>() / row.len() as f32;
    (mean, 1.0 / (variance + epsilon).sqrt())
}
