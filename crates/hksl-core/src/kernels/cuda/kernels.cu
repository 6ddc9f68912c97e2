// GPU kernels, compiled at run time on first use. Each thread computes one element of the result, or each warp one row in
// layer normalisation, and loops if there are more elements than threads. All tensors are contiguous.

#define EACH(index, count) \
    for (unsigned index = blockIdx.x * blockDim.x + threadIdx.x; index < count; index += gridDim.x * blockDim.x)

// Strides of the maps by axis, in elements.
struct Strides {
    unsigned image, row, column, channel;
};

// Conversion of map elements to f32. float4 processes four channels with one load and one store.
__device__ float to_float(float number) { return number; }
__device__ float4 to_float(float4 numbers) { return numbers; }
__device__ float to_float(unsigned char byte) { return byte * (1.0f / 255.0f); }

__device__ float sum(float a, float b) { return a + b; }
__device__ float4 sum(float4 a, float4 b) { return make_float4(a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w); }

// im2col: the matrix (B, rows, columns, side, side, C) of the input patches of a convolution.
template <typename From, typename To>
__device__ void gather(unsigned count, unsigned rows, unsigned columns, unsigned channels, unsigned side,
                        unsigned step, Strides strides, const From* maps, To* result) {
    EACH(index, count) {
        unsigned rest = index;
        const unsigned channel = rest % channels;
        rest /= channels;
        const unsigned across = rest % side;
        rest /= side;
        const unsigned down = rest % side;
        rest /= side;
        const unsigned column = rest % columns * step + across;
        rest /= columns;
        const unsigned row = rest % rows * step + down;
        const unsigned image = rest / rows;
        const unsigned position = image * strides.image + row * strides.row + column * strides.column;
        result[index] = to_float(maps[position + channel * strides.channel]);
    }
}

// col2im, the transpose of im2col: each element of the maps (B, height, width, C) is the sum of its copies in the matrix.
template <typename T>
__device__ void scatter_sum(unsigned count, unsigned rows, unsigned columns, unsigned channels, unsigned side,
                       unsigned step, unsigned height, unsigned width, const T* patches, T* result) {
    EACH(index, count) {
        unsigned rest = index;
        const unsigned channel = rest % channels;
        rest /= channels;
        const unsigned column = rest % width;
        rest /= width;
        const unsigned row = rest % height;
        const unsigned image = rest / height;
        T total = {};
        for (unsigned down = 0; down < side && down <= row; ++down) {
            const unsigned from_row = (row - down) / step;
            if (from_row * step + down != row || from_row >= rows) continue;
            for (unsigned across = 0; across < side && across <= column; ++across) {
                const unsigned from_column = (column - across) / step;
                if (from_column * step + across != column || from_column >= columns) continue;
                const unsigned position = (image * rows + from_row) * columns + from_column;
                total = sum(total, patches[((position * side + down) * side + across) * channels + channel]);
            }
        }
        result[index] = total;
    }
}

#define IM2COL_SIZES unsigned count, unsigned rows, unsigned columns, unsigned channels, unsigned side, unsigned step, \
               unsigned height, unsigned width

// im2col of u8 images (B, C, height, width), scaled by 1/255.
extern "C" __global__ void im2col_u8(IM2COL_SIZES, const unsigned char* images, float* result) {
    const Strides strides = {channels * height * width, width, 1, height * width};
    gather(count, rows, columns, channels, side, step, strides, images, result);
}

// im2col of f32 maps (B, height, width, C).
extern "C" __global__ void im2col(IM2COL_SIZES, const float* maps, float* result) {
    const Strides strides = {height * width * channels, width * channels, channels, 1};
    gather(count, rows, columns, channels, side, step, strides, maps, result);
}

extern "C" __global__ void im2col_by_four(IM2COL_SIZES, const float4* maps, float4* result) {
    const Strides strides = {height * width * channels, width * channels, channels, 1};
    gather(count, rows, columns, channels, side, step, strides, maps, result);
}

extern "C" __global__ void col2im(IM2COL_SIZES, const float* patches, float* result) {
    scatter_sum(count, rows, columns, channels, side, step, height, width, patches, result);
}

extern "C" __global__ void col2im_by_four(IM2COL_SIZES, const float4* patches, float4* result) {
    scatter_sum(count, rows, columns, channels, side, step, height, width, patches, result);
}

// Activation functions, numbered as in Activation::number.
enum Activation { NONE = 0, RELU = 1, ELU = 2 };

// Adds the bias (width) to values (N, width) and applies the activation, in place.
extern "C" __global__ void bias_and_activation(unsigned count, unsigned width, int activation, const float* bias,
                                               float* values) {
    EACH(index, count) {
        const float x = values[index] + bias[index % width];
        if (activation == RELU) {
            values[index] = fmaxf(x, 0.0f);
        } else if (activation == ELU) {
            values[index] = x > 0.0f ? x : expm1f(x);
        } else {
            values[index] = x;
        }
    }
}

// The gradient before the activation, from the output and the gradient after it.
extern "C" __global__ void activation_backward(unsigned count, int activation, const float* output,
                                             const float* gradient, float* result) {
    EACH(index, count) {
        const float y = output[index];
        float slope = 1.0f;
        if (activation != NONE && !(y > 0.0f)) {
            slope = activation == ELU ? y + 1.0f : 0.0f;
        }
        // 0 without multiplication: the gradient of an inactive ReLU may be infinite.
        result[index] = slope == 0.0f ? 0.0f : gradient[index] * slope;
    }
}

__device__ float sigmoid(float x) { return 1.0f / (1.0f + expf(-x)); }

extern "C" __global__ void apply_gate(unsigned count, const float* gates, const float* values, float* result) {
    EACH(index, count) {
        result[index] = sigmoid(gates[index]) * values[index];
    }
}

// (2, count): the gradients of gates and values.
extern "C" __global__ void apply_gate_backward(unsigned count, const float* gates, const float* values,
                                      const float* gradients, float* result) {
    EACH(index, count) {
        const float open = sigmoid(gates[index]), gradient = gradients[index];
        result[index] = gradient * values[index] * open * (1.0f - open);
        result[count + index] = gradient * open;
    }
}

extern "C" __global__ void gru_update(unsigned count, const float* gates, const float* candidates, const float* old,
                                   float* result) {
    EACH(index, count) {
        result[index] = old[index] + sigmoid(gates[index]) * (tanhf(candidates[index]) - old[index]);
    }
}

// (3, count): the gradients of gates, candidates and old state.
extern "C" __global__ void gru_update_backward(unsigned count, const float* gates, const float* candidates,
                                        const float* old, const float* gradients, float* result) {
    EACH(index, count) {
        const float open = sigmoid(gates[index]), gradient = gradients[index];
        const float fresh = tanhf(candidates[index]);
        result[index] = gradient * (fresh - old[index]) * open * (1.0f - open);
        result[count + index] = gradient * open * (1.0f - fresh * fresh);
        result[2 * count + index] = gradient * (1.0f - open);
    }
}

// The sum over a warp's lanes, returned to all lanes.
__device__ float over_lanes(float number) {
    for (unsigned apart = 16; apart > 0; apart /= 2) {
        number += __shfl_xor_sync(0xffffffffu, number, apart);
    }
    return number;
}

// Mean and inverse standard deviation of a row.
__device__ float2 row_moments(unsigned size, unsigned lane, float epsilon, const float* row) {
    float sum = 0.0f, squares = 0.0f;
    for (unsigned at = lane; at < size; at += 32) sum += row[at];
    const float mean = over_lanes(sum) / size;
    for (unsigned at = lane; at < size; at += 32) squares += (row[at] - mean) * (row[at] - mean);
    return make_float2(mean, 1.0f / sqrtf(over_lanes(squares) / size + epsilon));
}

// Layer normalisation of rows (N, size); count is 32 N.
extern "C" __global__ void layer_norm(unsigned count, unsigned size, float epsilon, const float* x,
                                      const float* weight, const float* bias, float* result) {
    EACH(index, count) {
        const unsigned lane = index % 32, start = index / 32 * size;
        const float2 moments = row_moments(size, lane, epsilon, x + start);
        for (unsigned at = lane; at < size; at += 32) {
            result[start + at] = (x[start + at] - moments.x) * moments.y * weight[at] + bias[at];
        }
    }
}

// (2, N, size): the gradients of x and of the weight before the sum over rows.
extern "C" __global__ void layer_norm_backward(unsigned count, unsigned size, float epsilon, const float* x,
                                           const float* weight, const float* gradient, float* result) {
    EACH(index, count) {
        const unsigned lane = index % 32, start = index / 32 * size;
        const float2 moments = row_moments(size, lane, epsilon, x + start);
        float sum = 0.0f, product = 0.0f;
        for (unsigned at = lane; at < size; at += 32) {
            const float towards = gradient[start + at] * weight[at];
            sum += towards;
            product += towards * (x[start + at] - moments.x) * moments.y;
        }
        sum = over_lanes(sum) / size;
        product = over_lanes(product) / size;
        for (unsigned at = lane; at < size; at += 32) {
            const float normed = (x[start + at] - moments.x) * moments.y;
            const float towards = gradient[start + at] * weight[at];
            result[start + at] = moments.y * (towards - sum - normed * product);
            result[count / 32 * size + start + at] = gradient[start + at] * normed;
        }
    }
}

// Update of Adam's moments (2, count): means of the gradients and of their squares.
extern "C" __global__ void adam_moments(unsigned count, float beta1, float beta2, float scale, float l2,
                                        const float* gradients, const float* weights, float* moments) {
    EACH(index, count) {
        const float gradient = gradients[index] * scale + weights[index] * l2;
        float *mean = moments + index, *square = moments + count + index;
        *mean = *mean * beta1 + gradient * (1.0f - beta1);
        *square = *square * beta2 + gradient * gradient * (1.0f - beta2);
    }
}

// Update of the weights with the moments.
extern "C" __global__ void adam_step(unsigned count, float rate, float root_correction2, float epsilon, float kept,
                                     const float* moments, float* weights) {
    EACH(index, count) {
        const float length = sqrtf(moments[count + index]) / root_correction2 + epsilon;
        weights[index] = (weights[index] - rate * moments[index] / length) * kept;
    }
}

// Soft update: target <- target + tau (source - target).
extern "C" __global__ void moving_average(unsigned count, float tau, const float* source, float* target) {
    EACH(index, count) {
        target[index] += tau * (source[index] - target[index]);
    }
}
