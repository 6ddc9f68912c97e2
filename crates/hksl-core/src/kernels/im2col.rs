//! im2col and col2im on slices.
//!
//! im2col writes the input patch of each output position into one row, so that a convolution becomes one matrix product,
//! which is fast on GPUs. The functions here are the CPU counterparts of the GPU kernels; tests without a GPU use them.

/// Sizes of an im2col operation for a square kernel without padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Im2col {
    /// Rows and columns of the input.
    pub(crate) input_size: (usize, usize),
    /// Channels of the input, `C`.
    pub(crate) channels: usize,
    /// Kernel size, `k`.
    pub(crate) kernel: usize,
    /// Stride in both directions.
    pub(crate) stride: usize,
}

impl Im2col {
    /// Rows and columns of the convolution's output.
    pub(crate) fn output_size(&self) -> (usize, usize) {
        let along = |points: usize| (points - self.kernel) / self.stride + 1;
        (along(self.input_size.0), along(self.input_size.1))
    }

    /// Columns of the im2col matrix, `k·k·C`.
    pub(crate) fn columns(&self) -> usize {
        self.kernel * self.kernel * self.channels
    }

    /// The im2col matrix `(B·h·w, k·k·C)` of f32 maps `(B, H, W, C)`.
    pub(crate) fn im2col(&self, maps: &[f32]) -> Vec<f32> {
        let mut patches = Vec::with_capacity(self.count(maps.len()));
        self.each(maps.len(), |place| patches.push(maps[place]));
        patches
    }

    /// The im2col matrix `(B·h·w, k·k·C)` of u8 images `(B, C, H, W)`, scaled by 1/255.
    pub(crate) fn im2col_u8(&self, images: &[u8]) -> Vec<f32> {
        let (area, channels) = (self.input_size.0 * self.input_size.1, self.channels);
        let mut patches = Vec::with_capacity(self.count(images.len()));
        self.each(images.len(), |place| {
            let (point, channel) = (place / channels, place % channels);
            let (image, point) = (point / area, point % area);
            let byte = images[(image * channels + channel) * area + point];
            patches.push(f32::from(byte) * (1.0 / 255.0));
        });
        patches
    }

    /// col2im, the transpose of [`Self::im2col`]: sums the elements of the matrix that belong to the same element of the maps.
    pub(crate) fn col2im(&self, patches: &[f32]) -> Vec<f32> {
        let (rows, columns) = self.output_size();
        let batch = patches.len() / (rows * columns * self.columns());
        let mut maps = vec![0.0; batch * self.input_size.0 * self.input_size.1 * self.channels];
        let mut patches = patches.iter();
        self.each(maps.len(), |place| maps[place] += patches.next().copied().unwrap_or_default());
        maps
    }

    /// Number of elements of the im2col matrix for maps with `numbers` elements.
    fn count(&self, numbers: usize) -> usize {
        let (rows, columns) = self.output_size();
        numbers / (self.input_size.0 * self.input_size.1 * self.channels)
            * rows
            * columns
            * self.columns()
    }

    /// Calls `visit` with the index into the maps of each element of the im2col matrix, in the matrix's order. `numbers` is
    /// the number of elements of the maps.
    fn each(&self, numbers: usize, mut visit: impl FnMut(usize)) {
        let &Self { input_size: (height, width), channels, kernel: side, stride: step } = self;
        let (rows, columns) = self.output_size();
        for image in 0..numbers / (height * width * channels) {
            for (row, column) in (0..rows * columns).map(|place| (place / columns, place % columns))
            {
                for (down, across) in (0..side * side).map(|tap| (tap / side, tap % side)) {
                    let point =
                        (image * height + row * step + down) * width + column * step + across;
                    (0..channels).for_each(|channel| visit(point * channels + channel));
                }
            }
        }
    }
}
