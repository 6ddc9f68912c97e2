//! A pool of reusable buffers, and parallel allocation of zeros.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex};

use rayon::prelude::*;

/// Zeros that one thread writes at a time.
const ROW: usize = 1 << 11;
/// f32 elements per cache line.
const LINE: usize = 16;

/// Allocates `count` zeros. Large buffers are written by all threads.
pub(crate) fn zeros(count: usize) -> Vec<f32> {
    if count < 64 * ROW {
        return vec![0.0; count];
    }
    let rows = (0..count.div_ceil(ROW)).into_par_iter().with_min_len(16).map(|_| [0f32; ROW]);
    let mut numbers = rows.collect::<Vec<_>>().into_flattened();
    numbers.truncate(count);
    numbers
}

/// A pool of buffers for reuse without clearing. The large buffers of a learning step are therefore not allocated and
/// zeroed in each step.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pool(Arc<Mutex<Vec<Vec<f32>>>>);

impl Pool {
    /// Takes a buffer of `count` elements, aligned to a cache line, with arbitrary content.
    pub(crate) fn take(&self, count: usize) -> Block {
        let room = count + LINE - 1;
        let mut numbers = match self.0.lock() {
            Ok(mut free) => {
                let fitting = (0..free.len()).filter(|&index| free[index].len() >= room);
                let best = fitting.min_by_key(|&index| free[index].len());
                best.map_or_else(Vec::new, |index| free.swap_remove(index))
            }
            // Another thread panicked while holding the lock: allocate a new buffer.
            Err(_) => Vec::new(),
        };
        if numbers.len() < room {
            numbers = vec![0.0; room];
        }
        // A missed alignment would only cost speed.
        let start = numbers.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE - 1);
        Block { numbers, start, count, pool: self.clone() }
    }
}

/// A buffer from a [`Pool`], returned to the pool on drop.
#[derive(Debug)]
pub(crate) struct Block {
    numbers: Vec<f32>,
    start: usize,
    count: usize,
    pool: Pool,
}

impl Deref for Block {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.numbers[self.start..self.start + self.count]
    }
}

impl DerefMut for Block {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.numbers[self.start..self.start + self.count]
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        if let Ok(mut free) = self.pool.0.lock() {
            free.push(std::mem::take(&mut self.numbers));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_goes_back_and_comes_again() {
        let pool = Pool::default();
        let (mut small, large) = (pool.take(2), pool.take(100));
        small.copy_from_slice(&[1.0, 2.0]);
        let place = small.as_ptr();
        drop((small, large));
        let small = pool.take(2);
        assert_eq!((small.as_ptr(), &small[..]), (place, &[1.0, 2.0][..]));
        assert_eq!(pool.take(101).len(), 101);
        assert_eq!(pool.0.lock().unwrap().len(), 2);
    }
}
