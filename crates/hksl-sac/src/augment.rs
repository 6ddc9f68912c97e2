//! Random shift augmentation (Kostrikov et al., DrQ, arXiv 2004.13649; HKSL appendix).

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// A translation of an image in pixels. Positive values move the content up and to the left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shift {
    /// Rows.
    pub rows: isize,
    /// Columns.
    pub columns: isize,
}

impl Shift {
    /// Draws uniformly from the `(2·pad + 1)²` shifts of at most `pad` pixels in each direction.
    pub fn random(rng: &mut ChaCha8Rng, pad: usize) -> Self {
        let mut offset = || rng.random_range(0..=2 * pad) as isize - pad as isize;
        Self { rows: offset(), columns: offset() }
    }

    /// Writes the shifted image to `output`: each output pixel is the input pixel `rows` below and `columns` to the right,
    /// with edges replicated.
    ///
    /// # Shapes
    /// - `image`, `output`: `(C, height, width)`
    ///
    /// ```
    /// use hksl_sac::augment::Shift;
    ///
    /// let image = [1, 2, 3, 4, 5, 6];
    /// let mut output = [0; 6];
    /// Shift { rows: 0, columns: 1 }.apply(&image, 2, 3, &mut output);
    /// assert_eq!(output, [2, 3, 3, 5, 6, 6]);
    /// Shift { rows: -5, columns: 0 }.apply(&image, 2, 3, &mut output);
    /// assert_eq!(output, [1, 2, 3, 1, 2, 3]);
    /// ```
    pub fn apply(self, image: &[u8], height: usize, width: usize, output: &mut [u8]) {
        let (rows, columns) = (height as isize, width as isize);
        // Output columns `first..last` have a source inside the image; the columns outside replicate its edges.
        let first = (-self.columns).clamp(0, columns) as usize;
        let last = (columns - self.columns).clamp(0, columns) as usize;
        for (plane, output) in
            image.chunks_exact(height * width).zip(output.chunks_exact_mut(height * width))
        {
            for (row, output) in output.chunks_exact_mut(width).enumerate() {
                let source = (row as isize + self.rows).clamp(0, rows - 1) as usize;
                let source = &plane[source * width..(source + 1) * width];
                output[..first].fill(source[0]);
                output[last..].fill(source[width - 1]);
                if first < last {
                    let from = (first as isize + self.columns) as usize;
                    output[first..last].copy_from_slice(&source[from..from + last - first]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use hksl_core::rng::stream;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn all_shifts_are_drawn_about_equally_often() {
        let (mut rng, mut counts) = (stream(1, "augment"), [0usize; 9]);
        for _ in 0..9000 {
            let Shift { rows, columns } = Shift::random(&mut rng, 1);
            counts[(3 * (rows + 1) + columns + 1) as usize] += 1;
        }
        assert!(counts.iter().all(|count| (850..1150).contains(count)), "{counts:?}");
    }

    proptest! {
        #[test]
        fn every_pixel_is_the_nearest_one_of_the_image(
            height in 1usize..7, width in 1usize..7, rows in -8isize..9, columns in -8isize..9,
        ) {
            let image: Vec<u8> = (0..2 * height * width).map(|i| i as u8).collect();
            let mut output = vec![0; image.len()];
            Shift { rows, columns }.apply(&image, height, width, &mut output);
            for plane in 0..2 {
                for row in 0..height {
                    for column in 0..width {
                        let r = (row as isize + rows).clamp(0, height as isize - 1) as usize;
                        let c = (column as isize + columns).clamp(0, width as isize - 1) as usize;
                        let at = |r: usize, c: usize| (plane * height + r) * width + c;
                        prop_assert_eq!(output[at(row, column)], image[at(r, c)]);
                    }
                }
            }
        }
    }
}
