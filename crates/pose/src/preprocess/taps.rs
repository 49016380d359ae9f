//! Which picture columns, or rows, a tensor column covers, and how much of each.

use std::ops::Range;

/// Weights are multiples of `1 / ONE`. 256 keeps a row sum of 8-bit pixels inside 16 bits: `255 * 256 < 65536`.
pub(super) const ONE: u16 = 256;

/// For every tensor column (or row): which picture columns count how much.
#[derive(Debug, Clone, Default)]
pub(super) struct Taps {
    /// What this was computed for: edge, scale, columns, columns of the picture.
    key: Option<(f32, f32, usize, usize)>,
    start: Vec<usize>,
    /// Exclusive ends of each run in `weight`.
    end: Vec<usize>,
    weight: Vec<u16>,
    /// Weight of what lies outside the picture.
    outside: Vec<u16>,
    even: Even,
}

/// The same with equally many weights for each column, so that no branch depends on it; what is missing weighs 0.
#[derive(Debug, Clone, Default)]
pub(super) struct Even {
    /// Picture columns that any tensor column needs.
    pub(super) range: Range<usize>,
    /// Weights of a column.
    pub(super) width: usize,
    /// First number of the first picture column, from the start of `range`; a column has three.
    pub(super) first: Vec<usize>,
    pub(super) weight: Vec<f32>,
    /// Weight of what lies outside the picture, after the pass over the rows too: times [`ONE`].
    pub(super) outside: Vec<f32>,
}

/// What one tensor column covers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cover<'a> {
    /// First picture column.
    pub(super) start: usize,
    pub(super) weights: &'a [u16],
    /// Weight of what lies outside the picture.
    pub(super) outside: u16,
}

impl Taps {
    /// Does nothing, and says false, when it is asked the same again.
    pub(super) fn compute(&mut self, edge_px: f32, scale: f32, count: usize, limit: usize) -> bool {
        let key = Some((edge_px, scale, count, limit));
        if self.key == key {
            return false;
        }
        self.key = key;
        self.start.clear();
        self.end.clear();
        self.weight.clear();
        self.outside.clear();
        let (edge, scale) = (f64::from(edge_px), f64::from(scale));
        for i in 0..count {
            let (from, to) = if scale >= 1.0 {
                (edge + i as f64 * scale, edge + (i + 1) as f64 * scale)
            } else {
                // A box of one pixel around the centre is bilinear interpolation.
                let centre = edge + (i as f64 + 0.5) * scale;
                (centre - 0.5, centre + 0.5)
            };
            self.push_box(from, to, limit);
        }
        self.spread();
        true
    }

    /// Brings the columns to one width.
    fn spread(&mut self) {
        let mut even = std::mem::take(&mut self.even);
        even.first.clear();
        even.weight.clear();
        even.outside.clear();
        let covers = || (0..self.len()).map(|i| self.of(i));
        let used = || covers().filter(|c| !c.weights.is_empty());
        even.width = used().map(|c| c.weights.len()).max().unwrap_or(0);
        let first = used().map(|c| c.start).min().unwrap_or(0);
        even.range = first..used().map(|c| c.start + c.weights.len()).max().unwrap_or(0);
        for cover in covers() {
            even.first.push(if cover.weights.is_empty() { 0 } else { (cover.start - first) * 3 });
            even.weight.extend(cover.weights.iter().map(|w| f32::from(*w)));
            even.weight.resize(even.first.len() * even.width, 0.0);
            even.outside.push(f32::from(cover.outside) * f32::from(ONE));
        }
        self.even = even;
    }

    /// Pixels `[k, k + 1)` weigh what of the box they cover; the rounded cumulative cover makes the sum exact.
    fn push_box(&mut self, from: f64, to: f64, limit: usize) {
        // Values are 0 to ONE, so the nearest integer is what is left of half a step more.
        let cumulative = |x: f64| (((x - from) / (to - from)).clamp(0.0, 1.0) * f64::from(ONE) + 0.5) as u16;
        let first = from.floor().clamp(0.0, limit as f64) as usize;
        let last = to.ceil().clamp(0.0, limit as f64) as usize;
        let before = cumulative(first as f64);
        let mut covered = before;
        for k in first..last.max(first) {
            let next = cumulative((k + 1) as f64);
            self.weight.push(next - covered);
            covered = next;
        }
        self.start.push(first);
        self.end.push(self.weight.len());
        self.outside.push(ONE - (covered - before));
    }

    pub(super) fn len(&self) -> usize {
        self.start.len()
    }

    pub(super) fn of(&self, i: usize) -> Cover<'_> {
        let run = if i == 0 { 0 } else { self.end[i - 1] }..self.end[i];
        Cover { start: self.start[i], weights: &self.weight[run], outside: self.outside[i] }
    }

    pub(super) fn even(&self) -> &Even {
        &self.even
    }
}
