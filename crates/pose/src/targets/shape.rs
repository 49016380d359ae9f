//! What labels look like on a map: the bell of a joint, the line of a limb, and runs of columns that fit registers.

use std::ops::Range;

/// Gaussians end where they fall below this.
const CUT: f32 = 1e-7;

/// Cells of one axis of a map.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    pub(super) cells: usize,
    stride: f32,
    per_px: f32,
}

impl Axis {
    pub(super) fn new(cells: usize, stride: usize) -> Self {
        Self { cells, stride: stride as f32, per_px: 1.0 / stride as f32 }
    }

    /// Picture coordinate of the centre of a cell.
    #[inline(always)]
    pub(super) fn centre(self, cell: usize) -> f32 {
        (cell as f32 + 0.5) * self.stride - 0.5
    }

    /// Cells whose centres lie in `[from, to]`, and up to two more; the exact test is the caller's.
    #[inline(always)]
    fn between(self, from_px: f32, to_px: f32) -> Range<usize> {
        let cell = |px: f32| (px + 0.5) * self.per_px - 0.5;
        let within = |cell: f32| smaller(self.cells as f32, larger(0.0, cell)) as usize;
        let (first, last) = (within(cell(from_px)), within(cell(to_px) + 2.0));
        first..last.max(first)
    }

    /// Cells whose centres lie in `[from, to]`.
    #[inline(always)]
    pub(super) fn inside(self, from_px: f32, to_px: f32) -> Range<usize> {
        // Centres grow with the cell, so those inside follow each other.
        let mut cells = self.between(from_px, to_px);
        while !cells.is_empty() && !(self.centre(cells.start) >= from_px) {
            cells.start += 1;
        }
        while !cells.is_empty() && !(self.centre(cells.end - 1) <= to_px) {
            cells.end -= 1;
        }
        cells
    }
}

/// A Gaussian around a joint, where it is not below the cut.
pub(super) struct Bell {
    x: f32,
    y: f32,
    gain: f32,
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
}

impl Bell {
    #[inline(always)]
    pub(super) fn new((x, y): (f32, f32), sigma_px: f32, rows: Axis, columns: Axis) -> Self {
        let gain = -1.0 / (2.0 * sigma_px * sigma_px);
        let radius = (CUT.ln() / gain).sqrt();
        let (rows, columns) = (rows.between(y - radius, y + radius), columns.between(x - radius, x + radius));
        Self { x, y, gain, rows, columns }
    }

    /// Its factor in the column of a centre; a cell's value is that times the row's.
    #[inline(always)]
    pub(super) fn across(&self, centre: f32) -> f32 {
        (self.gain * (centre - self.x).powi(2)).exp()
    }

    /// Its factor in the row of a centre.
    #[inline(always)]
    pub(super) fn down(&self, centre: f32) -> f32 {
        (self.gain * (centre - self.y).powi(2)).exp()
    }
}

/// The cells between the ends of a limb and within its width.
pub(super) struct Line {
    x: f32,
    y: f32,
    pub(super) ux: f32,
    pub(super) uy: f32,
    length: f32,
    half: f32,
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
}

impl Line {
    #[inline(always)]
    pub(super) fn new((ax, ay): (f32, f32), (bx, by): (f32, f32), half: f32, rows: Axis, columns: Axis) -> Self {
        let (dx, dy) = (bx - ax, by - ay);
        let length = (dx * dx + dy * dy).sqrt();
        let (ux, uy) = (dx / length.max(1e-3), dy / length.max(1e-3));
        // A length that overflows has no direction.
        let rows = if length.is_finite() { rows.between(ay.min(by) - half, ay.max(by) + half) } else { 0..0 };
        let columns = columns.between(ax.min(bx) - half, ax.max(bx) + half);
        Self { x: ax, y: ay, ux, uy, length, half, rows, columns }
    }

    /// Whether it covers the centre `(x, y)`.
    #[inline(always)]
    pub(super) fn covers(&self, x: f32, y: f32) -> bool {
        let (x, y) = (x - self.x, y - self.y);
        let (forward, sideways) = (x * self.ux + y * self.uy, x * self.uy - y * self.ux);
        (0.0..=self.length).contains(&forward) && sideways.abs() <= self.half
    }
}

/// `N` columns in a row, and which of them are meant.
pub(super) struct Run<const N: usize> {
    pub(super) first: usize,
    from: u32,
    to: u32,
}

impl<const N: usize> Run<N> {
    #[inline(always)]
    pub(super) fn has(&self, i: usize) -> bool {
        (self.from..self.to).contains(&(i as u32))
    }
}

/// Covers columns by runs of `N` that all lie in the row; each column is meant by one of them.
pub(super) struct Runs<const N: usize> {
    columns: Range<usize>,
    /// Where the last run of a row starts.
    last: usize,
}

impl<const N: usize> Runs<N> {
    /// The row has at least `N` columns.
    #[inline(always)]
    pub(super) fn new(columns: Range<usize>, row: Axis) -> Self {
        Self { columns, last: row.cells - N }
    }
}

impl<const N: usize> Iterator for Runs<N> {
    type Item = Run<N>;

    #[inline(always)]
    fn next(&mut self) -> Option<Run<N>> {
        let Range { start, end } = self.columns;
        if start >= end {
            return None;
        }
        let first = start.min(self.last);
        self.columns.start = first + N;
        Some(Run { first, from: (start - first) as u32, to: (end - first) as u32 })
    }
}

/// The larger; `a` where `b` is no number. One instruction, unlike `f32::max`.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The smaller; `a` where `b` is no number.
#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}
