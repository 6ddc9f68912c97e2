//! Patches: what a convolution's kernel sees at each of its places, one row each.
//!
//! A convolution is then one matrix product of all rows. GPUs are fast at that; the functions here say on plain slices
//! what the GPU's kernels do, and the tests of those run on them where there is no GPU.

/// Where a square kernel is laid over maps, without padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Places {
    /// Rows and columns of the maps.
    pub(crate) maps: (usize, usize),
    /// Channels of the maps.
    pub(crate) channels: usize,
    /// Side of the kernel.
    pub(crate) side: usize,
    /// Points of the maps from one place to the next.
    pub(crate) step: usize,
}

impl Places {
    /// Rows and columns of places.
    pub(crate) fn grid(&self) -> (usize, usize) {
        let along = |points: usize| (points - self.side) / self.step + 1;
        (along(self.maps.0), along(self.maps.1))
    }

    /// Numbers of one patch.
    pub(crate) fn patch(&self) -> usize {
        self.side * self.side * self.channels
    }

    /// Patches `(B, rows, columns, side, side, C)` of maps `(B, height, width, C)`.
    pub(crate) fn patches(&self, maps: &[f32]) -> Vec<f32> {
        let mut patches = Vec::with_capacity(self.count(maps.len()));
        self.each(maps.len(), |place| patches.push(maps[place]));
        patches
    }

    /// Patches `(B, rows, columns, side, side, C)` of images `(B, C, height, width)`, white being 1.
    pub(crate) fn patches_of_bytes(&self, images: &[u8]) -> Vec<f32> {
        let (area, channels) = (self.maps.0 * self.maps.1, self.channels);
        let mut patches = Vec::with_capacity(self.count(images.len()));
        self.each(images.len(), |place| {
            let (point, channel) = (place / channels, place % channels);
            let (image, point) = (point / area, point % area);
            let byte = images[(image * channels + channel) * area + point];
            patches.push(f32::from(byte) * (1.0 / 255.0));
        });
        patches
    }

    /// The transpose of [`Self::patches`]: every number of the maps is the sum of where it was seen.
    pub(crate) fn sum(&self, patches: &[f32]) -> Vec<f32> {
        let (rows, columns) = self.grid();
        let batch = patches.len() / (rows * columns * self.patch());
        let mut maps = vec![0.0; batch * self.maps.0 * self.maps.1 * self.channels];
        let mut patches = patches.iter();
        self.each(maps.len(), |place| maps[place] += patches.next().copied().unwrap_or_default());
        maps
    }

    /// Numbers of all patches of maps that hold this many.
    fn count(&self, numbers: usize) -> usize {
        let (rows, columns) = self.grid();
        numbers / (self.maps.0 * self.maps.1 * self.channels) * rows * columns * self.patch()
    }

    /// Visits, in the order of the patches, where in maps of `numbers` numbers each of their numbers stands.
    fn each(&self, numbers: usize, mut visit: impl FnMut(usize)) {
        let &Self { maps: (height, width), channels, side, step } = self;
        let (rows, columns) = self.grid();
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
