//! Floating-point operations, counted where they are executed.

use std::ops::Sub;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Floating-point operations of convolutions and linear layers. A multiply-add counts as two. Elementwise operations are
/// not counted, nor are matrix products of candle's own, such as CURL's logits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Operations {
    /// Images that passed through a [`crate::nn::PixelEncoder`]. A forward pass counts an image once, a backward pass twice.
    pub encoder_images: u64,
    /// Operations, with convolutions counted by their definition.
    pub defined: u64,
    /// Operations as executed. Winograd convolutions need fewer than by definition.
    pub executed: u64,
}

impl Sub for Operations {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Self {
            encoder_images: self.encoder_images - earlier.encoder_images,
            defined: self.defined - earlier.defined,
            executed: self.executed - earlier.executed,
        }
    }
}

/// A running count, shared by all clones.
#[derive(Debug, Clone, Default)]
pub(crate) struct Counter(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    encoder_images: AtomicU64,
    defined: AtomicU64,
    executed: AtomicU64,
}

impl Counter {
    /// Adds one operation count per definition and one as executed.
    pub(crate) fn add(&self, defined: usize, executed: usize) {
        self.0.defined.fetch_add(defined as u64, Ordering::Relaxed);
        self.0.executed.fetch_add(executed as u64, Ordering::Relaxed);
    }

    /// Adds the product of matrices `(rows, inner)` and `(inner, columns)`.
    pub(crate) fn add_product(&self, rows: usize, inner: usize, columns: usize) {
        let operations = 2 * rows * inner * columns;
        self.add(operations, operations);
    }

    /// Adds passes of images through an encoder.
    pub(crate) fn add_encoder_images(&self, images: usize) {
        self.0.encoder_images.fetch_add(images as u64, Ordering::Relaxed);
    }

    /// The count so far.
    pub(crate) fn read(&self) -> Operations {
        let Counts { encoder_images, defined, executed } = &*self.0;
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        Operations {
            encoder_images: read(encoder_images),
            defined: read(defined),
            executed: read(executed),
        }
    }
}
