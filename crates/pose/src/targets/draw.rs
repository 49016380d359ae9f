//! The targets of one picture, cell by cell where they are not zero.
//!
//! All maps of a picture are emptied first, in long runs, then drawn channel by channel, each corrected by the teacher's while
//! it lies in the first cache.

use std::ops::Range;

use pulp::NullaryFnOnce;

use super::{JointState, TargetParams, fuse};

/// Gaussians end where they fall below this.
const CUT: f32 = 1e-7;
/// A hidden joint is left out within this many sigmas.
const MASK_RADIUS: f32 = 3.0;
/// A direction component below this bounds nothing: to divide by it costs digits, and the other component bounds enough.
const FLAT: f32 = 0.01;

pub(super) struct Sample<'a> {
    pub(super) params: &'a TargetParams,
    pub(super) ends: &'a [[usize; 2]],
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) joints_px: &'a [f32],
    pub(super) states: &'a [u8],
    pub(super) boxes_px: &'a [f32],
    /// The teacher's maps and fields, and its floor.
    pub(super) teacher: Option<(&'a [f32], &'a [f32], f32)>,
}

const UNKNOWN: u8 = JointState::Unknown as u8;
const HIDDEN: u8 = JointState::Hidden as u8;
const OUTSIDE: u8 = JointState::Outside as u8;
const LABELLED: u8 = JointState::Labelled as u8;

/// A picture's labels and where its maps go, to be drawn with the widest registers there are.
pub(super) struct Picture<'a> {
    pub(super) sample: Sample<'a>,
    pub(super) pcm: &'a mut [f32],
    pub(super) pcm_mask: &'a mut [f32],
    pub(super) paf: &'a mut [f32],
    pub(super) paf_mask: &'a mut [f32],
}

impl NullaryFnOnce for Picture<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.pcm.fill(0.0);
        self.pcm_mask.fill(1.0);
        self.paf.fill(0.0);
        self.paf_mask.fill(1.0);
        self.sample.parts(self.pcm, self.pcm_mask);
        self.sample.fields(self.paf, self.paf_mask);
    }
}

impl Sample<'_> {
    #[inline(always)]
    fn joints(&self) -> usize {
        self.params.skeleton.len()
    }

    #[inline(always)]
    fn people(&self) -> usize {
        self.states.len() / self.joints()
    }

    #[inline(always)]
    fn place(&self, person: usize, joint: usize) -> (f32, f32) {
        let i = (person * self.joints() + joint) * 2;
        (self.joints_px[i], self.joints_px[i + 1])
    }

    #[inline(always)]
    fn state(&self, person: usize, joint: usize) -> u8 {
        self.states[person * self.joints() + joint]
    }

    /// Picture coordinate of the centre of a cell.
    #[inline(always)]
    fn centre(&self, cell: usize) -> f32 {
        (cell as f32 + 0.5) * self.params.stride as f32 - 0.5
    }

    /// Cells whose centres lie in `[from, to]`, a little generous; the exact test is the caller's.
    #[inline(always)]
    fn cells(&self, from_px: f32, to_px: f32, limit: usize) -> Range<usize> {
        let stride = self.params.stride as f32;
        let cell = |px: f32| (px + 0.5) / stride - 0.5;
        let first = cell(from_px).floor().clamp(0.0, limit as f32) as usize;
        let last = (cell(to_px).ceil() + 1.0).clamp(0.0, limit as f32) as usize;
        first..last.max(first)
    }

    /// Confidence maps and background.
    #[inline(always)]
    pub(super) fn parts(&self, pcm: &mut [f32], mask: &mut [f32]) {
        let cells = self.rows * self.columns;
        let (pcm, background) = pcm.split_at_mut(self.joints() * cells);
        let (mask, background_mask) = mask.split_at_mut(self.joints() * cells);
        // `background` is the most of all labels until all are drawn.
        let mut across = Vec::new();
        let mut most = fuse::Most::new(cells);
        for (joint, (map, mask)) in pcm.chunks_exact_mut(cells).zip(mask.chunks_exact_mut(cells)).enumerate() {
            for person in 0..self.people() {
                match self.state(person, joint) {
                    LABELLED => self.gaussian(person, joint, &mut across, |run, down, across| {
                        for ((cell, most), g) in map[run.clone()].iter_mut().zip(&mut background[run]).zip(across) {
                            let g = down * g;
                            *cell = if g > *cell { g } else { *cell };
                            *most = if g > *most { g } else { *most };
                        }
                    }),
                    HIDDEN => self.near(person, joint, &mut across, |cell| {
                        mask[cell] = 0.0;
                        background_mask[cell] = 0.0;
                    }),
                    UNKNOWN => self.in_box(person, |run| mask[run].fill(0.0)),
                    _ => {}
                }
            }
            if let Some((teacher, _, floor)) = self.teacher {
                fuse::part(map, mask, &teacher[joint * cells..][..cells], floor, &mut most);
            }
        }
        for most in &mut *background {
            *most = 1.0 - *most;
        }
        for person in 0..self.people() {
            if (0..self.joints()).any(|j| self.state(person, j) == UNKNOWN) {
                self.in_box(person, |run| {
                    for (mask, background) in background_mask[run.clone()].iter_mut().zip(&background[run]) {
                        if *background > 0.5 {
                            *mask = 0.0;
                        }
                    }
                });
            }
        }
        if self.teacher.is_some() {
            fuse::background(background, background_mask, &most);
        }
    }

    /// Affinity fields.
    #[inline(always)]
    pub(super) fn fields(&self, paf: &mut [f32], mask: &mut [f32]) {
        let cells = self.rows * self.columns;
        let mut shared = Shared { count: vec![0; cells], ..Shared::default() };
        let maps = paf.chunks_exact_mut(2 * cells).zip(mask.chunks_exact_mut(2 * cells));
        for (limb, (ends, (paf, mask))) in self.ends.iter().zip(maps).enumerate() {
            self.field(*ends, paf, mask, &mut shared);
            if let Some((_, teacher, floor)) = self.teacher {
                fuse::field(paf, mask, &teacher[limb * 2 * cells..][..2 * cells], floor);
            }
        }
    }

    /// Row by row the run of cells, the factor of the row, and those of its columns.
    #[inline(always)]
    fn gaussian(
        &self,
        person: usize,
        joint: usize,
        across: &mut Vec<f32>,
        mut visit: impl FnMut(Range<usize>, f32, &[f32]),
    ) {
        let (x, y) = self.place(person, joint);
        let gain = -1.0 / (2.0 * self.params.sigma_px * self.params.sigma_px);
        let radius = (CUT.ln() / gain).sqrt();
        let columns = self.cells(x - radius, x + radius, self.columns);
        across.clear();
        across.extend(columns.clone().map(|c| (gain * (self.centre(c) - x).powi(2)).exp()));
        for row in self.cells(y - radius, y + radius, self.rows) {
            let down = (gain * (self.centre(row) - y).powi(2)).exp();
            let first = row * self.columns;
            visit(first + columns.start..first + columns.end, down, across);
        }
    }

    #[inline(always)]
    fn near(&self, person: usize, joint: usize, across: &mut Vec<f32>, mut visit: impl FnMut(usize)) {
        let edge = (-MASK_RADIUS * MASK_RADIUS / 2.0).exp();
        self.gaussian(person, joint, across, |run, down, across| {
            run.zip(across).filter(|(_, g)| down * **g > edge).for_each(|(cell, _)| visit(cell));
        });
    }

    /// The runs of cells of a person's box.
    #[inline(always)]
    fn in_box(&self, person: usize, mut visit: impl FnMut(Range<usize>)) {
        let b = &self.boxes_px[person * 4..person * 4 + 4];
        // Centres grow with the cell, so those inside follow each other.
        let inside = |from, to, limit| {
            let mut cells = self.cells(from, to, limit);
            while !cells.is_empty() && !(self.centre(cells.start) >= from) {
                cells.start += 1;
            }
            while !cells.is_empty() && !(self.centre(cells.end - 1) <= to) {
                cells.end -= 1;
            }
            cells
        };
        let columns = inside(b[0], b[2], self.columns);
        for row in inside(b[1], b[3], self.rows) {
            visit(row * self.columns + columns.start..row * self.columns + columns.end);
        }
    }

    /// Cells between the ends of a limb and within its width, with its direction.
    #[inline(always)]
    fn on_limb(&self, person: usize, [from, to]: [usize; 2], mut visit: impl FnMut(usize, f32, f32)) {
        let ((ax, ay), (bx, by)) = (self.place(person, from), self.place(person, to));
        let (dx, dy) = (bx - ax, by - ay);
        let length = (dx * dx + dy * dy).sqrt();
        let (ux, uy) = (dx / length.max(1e-3), dy / length.max(1e-3));
        let half = self.params.half_width_px;
        let (left, right) = (ax.min(bx) - half, ax.max(bx) + half);
        for row in self.cells(ay.min(by) - half, ay.max(by) + half, self.rows) {
            let y = self.centre(row) - ay;
            // Where the row enters and leaves the strip between the ends, and the strip around the line.
            let (a, b) = between(ux, y * uy, 0.0, length);
            let (c, d) = between(uy, -y * ux, -half, half);
            for column in self.cells(left.max(ax + a).max(ax + c), right.min(ax + b).min(ax + d), self.columns) {
                let x = self.centre(column) - ax;
                let (forward, sideways) = (x * ux + y * uy, x * uy - y * ux);
                if (0.0..=length).contains(&forward) && sideways.abs() <= half {
                    visit(row * self.columns + column, ux, uy);
                }
            }
        }
    }

    #[inline(always)]
    fn field(&self, ends: [usize; 2], paf: &mut [f32], mask: &mut [f32], shared: &mut Shared) {
        let cells = self.rows * self.columns;
        let (px, py) = paf.split_at_mut(cells);
        let (mx, my) = mask.split_at_mut(cells);
        for person in 0..self.people() {
            let states = ends.map(|j| self.state(person, j));
            if states == [LABELLED; 2] {
                self.on_limb(person, ends, |cell, ux, uy| {
                    px[cell] += ux;
                    py[cell] += uy;
                    shared.add(cell);
                });
            } else if states.contains(&UNKNOWN) && !states.contains(&OUTSIDE) {
                self.in_box(person, |run| {
                    mx[run.clone()].fill(0.0);
                    my[run].fill(0.0);
                });
            } else if !states.contains(&OUTSIDE) {
                self.on_limb(person, ends, |cell, _, _| {
                    mx[cell] = 0.0;
                    my[cell] = 0.0;
                });
            }
        }
        shared.drain(|cell, n| {
            px[cell] /= n;
            py[cell] /= n;
        });
    }
}

/// Where `low <= slope x + offset <= high`; everywhere when the slope says nothing.
fn between(slope: f32, offset: f32, low: f32, high: f32) -> (f32, f32) {
    if slope.abs() < FLAT {
        return (f32::NEG_INFINITY, f32::INFINITY);
    }
    let (a, b) = ((low - offset) / slope, (high - offset) / slope);
    (a.min(b), a.max(b))
}

/// Cells that limbs of several people cover.
#[derive(Default)]
struct Shared {
    /// People in each cell; all 0 between limbs.
    count: Vec<u16>,
    touched: Vec<usize>,
}

impl Shared {
    #[inline(always)]
    fn add(&mut self, cell: usize) {
        if self.count[cell] == 0 {
            self.touched.push(cell);
        }
        self.count[cell] += 1;
    }

    /// Visits the cells of more than one, and forgets all.
    #[inline(always)]
    fn drain(&mut self, mut visit: impl FnMut(usize, f32)) {
        for cell in self.touched.drain(..) {
            let n = std::mem::take(&mut self.count[cell]);
            if n > 1 {
                visit(cell, f32::from(n));
            }
        }
    }
}
