// The GPU's kernels, compiled at run time when the first of them is wanted. A thread has one place of the result, a warp
// one row where rows are normalised, and both go on with another where there are more places than threads. All tensors
// are contiguous.

#define EACH(index, count) \
    for (unsigned index = blockIdx.x * blockDim.x + threadIdx.x; index < count; index += gridDim.x * blockDim.x)

// Numbers from one to the next, by axis of the maps.
struct Strides {
    unsigned image, row, column, channel;
};

// What the maps' numbers become in a patch: four channels at once where their count allows it, for one load and one
// store in place of four.
__device__ float seen(float number) { return number; }
__device__ float4 seen(float4 numbers) { return numbers; }
__device__ float seen(unsigned char byte) { return byte * (1.0f / 255.0f); }

__device__ float sum(float a, float b) { return a + b; }
__device__ float4 sum(float4 a, float4 b) { return make_float4(a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w); }

// (B, rows, columns, side, side, C): what a convolution's kernel sees at each of its places.
template <typename From, typename To>
__device__ void patches(unsigned count, unsigned rows, unsigned columns, unsigned channels, unsigned side,
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
        const unsigned place = image * strides.image + row * strides.row + column * strides.column;
        result[index] = seen(maps[place + channel * strides.channel]);
    }
}

// The transpose: each number of the maps (B, height, width, C) is the sum of where it was seen.
template <typename T>
__device__ void sum_of(unsigned count, unsigned rows, unsigned columns, unsigned channels, unsigned side,
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
                const unsigned place = (image * rows + from_row) * columns + from_column;
                total = sum(total, patches[((place * side + down) * side + across) * channels + channel]);
            }
        }
        result[index] = total;
    }
}

#define PLACES unsigned count, unsigned rows, unsigned columns, unsigned channels, unsigned side, unsigned step, \
               unsigned height, unsigned width

// Of images (B, C, height, width) of bytes, white being 1.
extern "C" __global__ void patches_of_images(PLACES, const unsigned char* images, float* result) {
    const Strides strides = {channels * height * width, width, 1, height * width};
    patches(count, rows, columns, channels, side, step, strides, images, result);
}

// Of maps (B, height, width, C).
extern "C" __global__ void patches_of_maps(PLACES, const float* maps, float* result) {
    const Strides strides = {height * width * channels, width * channels, channels, 1};
    patches(count, rows, columns, channels, side, step, strides, maps, result);
}

extern "C" __global__ void patches_of_maps_by_four(PLACES, const float4* maps, float4* result) {
    const Strides strides = {height * width * channels, width * channels, channels, 1};
    patches(count, rows, columns, channels, side, step, strides, maps, result);
}

extern "C" __global__ void sum_of_patches(PLACES, const float* patches, float* result) {
    sum_of(count, rows, columns, channels, side, step, height, width, patches, result);
}

extern "C" __global__ void sum_of_patches_by_four(PLACES, const float4* patches, float4* result) {
    sum_of(count, rows, columns, channels, side, step, height, width, patches, result);
}

// What follows an affine map, numbered as by Activation::number.
enum Activation { NONE = 0, RELU = 1, ELU = 2 };

// values (N, width) + bias (width), then the activation, in place.
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

// The gradient before the activation, from the one after it and from its output.
extern "C" __global__ void before_activation(unsigned count, int activation, const float* output,
                                             const float* gradient, float* result) {
    EACH(index, count) {
        const float y = output[index];
        float slope = 1.0f;
        if (activation != NONE && !(y > 0.0f)) {
            slope = activation == ELU ? y + 1.0f : 0.0f;
        }
        // Not the product: the gradient may be infinite where ReLU lets nothing through.
        result[index] = slope == 0.0f ? 0.0f : gradient[index] * slope;
    }
}

__device__ float sigmoid(float x) { return 1.0f / (1.0f + expf(-x)); }

extern "C" __global__ void gated(unsigned count, const float* gates, const float* values, float* result) {
    EACH(index, count) {
        result[index] = sigmoid(gates[index]) * values[index];
    }
}

// (2, count): towards the gates, towards the values.
extern "C" __global__ void gated_back(unsigned count, const float* gates, const float* values,
                                      const float* gradients, float* result) {
    EACH(index, count) {
        const float open = sigmoid(gates[index]), gradient = gradients[index];
        result[index] = gradient * values[index] * open * (1.0f - open);
        result[count + index] = gradient * open;
    }
}

extern "C" __global__ void blended(unsigned count, const float* gates, const float* candidates, const float* old,
                                   float* result) {
    EACH(index, count) {
        result[index] = old[index] + sigmoid(gates[index]) * (tanhf(candidates[index]) - old[index]);
    }
}

// (3, count): towards the gates, the candidates, the old.
extern "C" __global__ void blended_back(unsigned count, const float* gates, const float* candidates,
                                        const float* old, const float* gradients, float* result) {
    EACH(index, count) {
        const float open = sigmoid(gates[index]), gradient = gradients[index];
        const float fresh = tanhf(candidates[index]);
        result[index] = gradient * (fresh - old[index]) * open * (1.0f - open);
        result[count + index] = gradient * open * (1.0f - fresh * fresh);
        result[2 * count + index] = gradient * (1.0f - open);
    }
}

// Rows by warps: the sum over a row's lanes, known to all of them.
__device__ float over_lanes(float number) {
    for (unsigned apart = 16; apart > 0; apart /= 2) {
        number += __shfl_xor_sync(0xffffffffu, number, apart);
    }
    return number;
}

// Mean, and one over the standard deviation.
__device__ float2 row_moments(unsigned size, unsigned lane, float epsilon, const float* row) {
    float sum = 0.0f, squares = 0.0f;
    for (unsigned at = lane; at < size; at += 32) sum += row[at];
    const float mean = over_lanes(sum) / size;
    for (unsigned at = lane; at < size; at += 32) squares += (row[at] - mean) * (row[at] - mean);
    return make_float2(mean, 1.0f / sqrtf(over_lanes(squares) / size + epsilon));
}

// Of rows (N, size), count being 32 N.
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

// (2, N, size): the gradient towards x, and that towards the weight before the sum over rows.
extern "C" __global__ void layer_norm_back(unsigned count, unsigned size, float epsilon, const float* x,
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

// The moments (2, count) of Adam: mean of the gradients, and of their squares.
extern "C" __global__ void adam_moments(unsigned count, float beta1, float beta2, float scale, float l2,
                                        const float* gradients, const float* weights, float* moments) {
    EACH(index, count) {
        const float gradient = gradients[index] * scale + weights[index] * l2;
        float *mean = moments + index, *square = moments + count + index;
        *mean = *mean * beta1 + gradient * (1.0f - beta1);
        *square = *square * beta2 + gradient * gradient * (1.0f - beta2);
    }
}

// The weights' step along them.
extern "C" __global__ void adam_step(unsigned count, float rate, float root_correction2, float epsilon, float kept,
                                     const float* moments, float* weights) {
    EACH(index, count) {
        const float length = sqrtf(moments[count + index]) / root_correction2 + epsilon;
        weights[index] = (weights[index] - rate * moments[index] / length) * kept;
    }
}

// target <- target + tau (source - target).
extern "C" __global__ void moving_average(unsigned count, float tau, const float* source, float* target) {
    EACH(index, count) {
        target[index] += tau * (source[index] - target[index]);
    }
}
