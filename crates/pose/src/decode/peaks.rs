//! Peaks of a confidence map, finer than its cells.
//!
//! A cell is a peak when it is at least the threshold and above its eight neighbours (equal neighbours: the first in
//! reading order wins). Its place is refined along each axis by the parabola through the *logarithms* of three
//! neighbouring cells: the maps are trained as Gaussians, whose logarithm is a parabola, so the refinement of a clean
//! peak is exact.

/// A peak of a confidence map, in cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Column, cells; 0 is the centre of the first cell.
    pub x: f32,
    /// Row, cells.
    pub y: f32,
    /// Value of the cell.
    pub score: f32,
}

/// Values below this are raised to it before the logarithm. It is far below any threshold in use, so only the far flank
/// of a peak at its neighbour is concerned, where a larger value would pull the peak to the middle of its cell.
const FLOOR: f32 = 1e-3;

/// All peaks of a `height x width` map that reach `threshold`, strongest first, at most `limit`.
pub(crate) fn find(map: &[f32], width: usize, height: usize, threshold: f32, limit: usize, out: &mut Vec<Peak>) {
    out.clear();
    for y in 0..height {
        let row = &map[y * width..(y + 1) * width];
        for (x, &value) in row.iter().enumerate() {
            if value >= threshold && is_peak(map, width, height, x, y, value) {
                let at = |dx: isize, dy: isize| neighbour(map, width, height, x, y, dx, dy);
                out.push(Peak {
                    x: x as f32 + refine(at(-1, 0), value, at(1, 0)),
                    y: y as f32 + refine(at(0, -1), value, at(0, 1)),
                    score: value,
                });
            }
        }
    }
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out.truncate(limit);
}

fn neighbour(map: &[f32], width: usize, height: usize, x: usize, y: usize, dx: isize, dy: isize) -> Option<f32> {
    let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
    (x < width && y < height).then(|| map[y * width + x])
}

fn is_peak(map: &[f32], width: usize, height: usize, x: usize, y: usize, value: f32) -> bool {
    for dy in -1..=1_isize {
        for dx in -1..=1_isize {
            let Some(other) = neighbour(map, width, height, x, y, dx, dy) else { continue };
            let earlier = (dy, dx) < (0, 0);
            if other > value || (earlier && other >= value) {
                return false;
            }
        }
    }
    true
}

/// Offset of the maximum from the middle of three cells, -1/2 to 1/2. At a border there is nothing to refine with.
fn refine(before: Option<f32>, middle: f32, after: Option<f32>) -> f32 {
    let (Some(before), Some(after)) = (before, after) else { return 0.0 };
    let [a, b, c] = [before, middle, after].map(|v| v.max(FLOOR).ln());
    let curvature = a - 2.0 * b + c;
    if curvature < 0.0 { ((a - c) / (2.0 * curvature)).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gaussians(width: usize, height: usize, centres: &[(f32, f32)], sigma: f32) -> Vec<f32> {
        let mut map = vec![0.0_f32; width * height];
        for y in 0..height {
            for x in 0..width {
                for (cx, cy) in centres {
                    let d2 = (x as f32 - cx).powi(2) + (y as f32 - cy).powi(2);
                    map[y * width + x] = map[y * width + x].max((-d2 / (2.0 * sigma * sigma)).exp());
                }
            }
        }
        map
    }

    proptest! {
        /// Judge: the Gaussian that made the map.
        #[test]
        fn a_gaussian_is_found_to_a_thousandth_of_a_cell(cx in 2.0..13.0_f32, cy in 2.0..9.0_f32, sigma in 0.8..2.0_f32) {
            let map = gaussians(16, 12, &[(cx, cy)], sigma);
            let mut peaks = Vec::new();
            find(&map, 16, 12, 0.1, 100, &mut peaks);
            prop_assert_eq!(peaks.len(), 1);
            prop_assert!((peaks[0].x - cx).abs() < 1e-3 && (peaks[0].y - cy).abs() < 1e-3, "{:?}", peaks[0]);
        }

        /// Judge: every cell looked at by hand.
        #[test]
        fn noise_has_the_peaks_that_a_plain_search_finds(values in proptest::collection::vec(0.0..1.0_f32, 80)) {
            let mut peaks = Vec::new();
            find(&values, 10, 8, 0.5, 1000, &mut peaks);
            let mut expected = 0;
            for y in 0..8_i32 {
                for x in 0..10_i32 {
                    let v = values[(y * 10 + x) as usize];
                    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
                    let above = around
                        .filter(|&(i, j)| (i, j) != (x, y) && (0..10).contains(&i) && (0..8).contains(&j))
                        .all(|(i, j)| v > values[(j * 10 + i) as usize]);
                    expected += usize::from(v >= 0.5 && above);
                }
            }
            prop_assert_eq!(peaks.len(), expected);
            prop_assert!(peaks.windows(2).all(|w| w[0].score >= w[1].score));
        }
    }

    #[test]
    fn a_plateau_is_one_peak_and_a_border_peak_stays_in_its_cell() {
        let mut peaks = Vec::new();
        find(&[0.0, 0.9, 0.9, 0.0], 4, 1, 0.1, 10, &mut peaks);
        assert_eq!(peaks.len(), 1);
        find(&[0.9, 0.2, 0.0, 0.0], 4, 1, 0.1, 10, &mut peaks);
        assert_eq!((peaks.len(), peaks[0].x.to_bits()), (1, 0.0_f32.to_bits()));
        find(&[0.05; 12], 4, 3, 0.1, 10, &mut peaks);
        assert!(peaks.is_empty());
        // Below the least value that has a logarithm all is flat.
        find(&[0.0, 5e-4, 2e-4], 3, 1, 1e-4, 10, &mut peaks);
        assert_eq!((peaks.len(), peaks[0].x.to_bits()), (1, 1.0_f32.to_bits()));
    }
}
