//! The targets of one picture, cell by cell where they are not zero.

use std::ops::Range;

use super::{JointState, TargetParams};

/// Gaussians end where they fall below this.
const CUT: f32 = 1e-7;
/// A hidden joint is left out within this many sigmas.
const MASK_RADIUS: f32 = 3.0;

pub(super) struct Sample<'a> {
    pub(super) params: &'a TargetParams,
    pub(super) ends: &'a [[usize; 2]],
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) joints_px: &'a [f32],
    pub(super) states: &'a [u8],
    pub(super) boxes_px: &'a [f32],
}

const UNKNOWN: u8 = JointState::Unknown as u8;
const HIDDEN: u8 = JointState::Hidden as u8;
const OUTSIDE: u8 = JointState::Outside as u8;
const LABELLED: u8 = JointState::Labelled as u8;

impl Sample<'_> {
    fn joints(&self) -> usize {
        self.params.skeleton.len()
    }

    fn people(&self) -> usize {
        self.states.len() / self.joints()
    }

    fn place(&self, person: usize, joint: usize) -> (f32, f32) {
        let i = (person * self.joints() + joint) * 2;
        (self.joints_px[i], self.joints_px[i + 1])
    }

    fn state(&self, person: usize, joint: usize) -> u8 {
        self.states[person * self.joints() + joint]
    }

    /// Picture coordinate of the centre of a cell.
    fn centre(&self, cell: usize) -> f32 {
        (cell as f32 + 0.5) * self.params.stride as f32 - 0.5
    }

    /// Cells whose centres lie in `[from, to]`, a little generous; the exact test is the caller's.
    fn cells(&self, from_px: f32, to_px: f32, limit: usize) -> Range<usize> {
        let stride = self.params.stride as f32;
        let cell = |px: f32| (px + 0.5) / stride - 0.5;
        let first = cell(from_px).floor().clamp(0.0, limit as f32) as usize;
        let last = (cell(to_px).ceil() + 1.0).clamp(0.0, limit as f32) as usize;
        first..last.max(first)
    }

    pub(super) fn draw(&self, pcm: &mut [f32], pcm_mask: &mut [f32], paf: &mut [f32], paf_mask: &mut [f32]) {
        let cells = self.rows * self.columns;
        pcm.fill(0.0);
        paf.fill(0.0);
        pcm_mask.fill(1.0);
        paf_mask.fill(1.0);
        for joint in 0..self.joints() {
            let (map, mask) = (&mut pcm[joint * cells..][..cells], &mut pcm_mask[joint * cells..][..cells]);
            for person in 0..self.people() {
                match self.state(person, joint) {
                    LABELLED => self.gaussian(person, joint, |cell, g| map[cell] = map[cell].max(g)),
                    HIDDEN => self.near(person, joint, |cell| mask[cell] = 0.0),
                    UNKNOWN => self.in_box(person, |cell| mask[cell] = 0.0),
                    _ => {}
                }
            }
        }
        let (parts, background) = pcm.split_at_mut(self.joints() * cells);
        background_of(parts, background, cells);
        let mask = &mut pcm_mask[self.joints() * cells..];
        for person in 0..self.people() {
            let is = |state| (0..self.joints()).any(|j| self.state(person, j) == state);
            for joint in (0..self.joints()).filter(|j| self.state(person, *j) == HIDDEN) {
                self.near(person, joint, |cell| mask[cell] = 0.0);
            }
            if is(UNKNOWN) {
                self.in_box(person, |cell| {
                    if background[cell] > 0.5 {
                        mask[cell] = 0.0;
                    }
                });
            }
        }
        let mut count = vec![0_u16; cells];
        for (limb, ends) in self.ends.iter().enumerate() {
            let range = limb * 2 * cells..(limb + 1) * 2 * cells;
            self.field(*ends, &mut paf[range.clone()], &mut paf_mask[range], &mut count);
        }
    }

    fn gaussian(&self, person: usize, joint: usize, mut visit: impl FnMut(usize, f32)) {
        let (x, y) = self.place(person, joint);
        let gain = -1.0 / (2.0 * self.params.sigma_px * self.params.sigma_px);
        let radius = (CUT.ln() / gain).sqrt();
        let columns = self.cells(x - radius, x + radius, self.columns);
        let across: Vec<f32> = columns.clone().map(|c| (gain * (self.centre(c) - x).powi(2)).exp()).collect();
        for row in self.cells(y - radius, y + radius, self.rows) {
            let down = (gain * (self.centre(row) - y).powi(2)).exp();
            for (column, g) in columns.clone().zip(&across) {
                visit(row * self.columns + column, down * g);
            }
        }
    }

    fn near(&self, person: usize, joint: usize, mut visit: impl FnMut(usize)) {
        let edge = (-MASK_RADIUS * MASK_RADIUS / 2.0).exp();
        self.gaussian(person, joint, |cell, g| {
            if g > edge {
                visit(cell);
            }
        });
    }

    fn in_box(&self, person: usize, mut visit: impl FnMut(usize)) {
        let b = &self.boxes_px[person * 4..person * 4 + 4];
        for row in self.cells(b[1], b[3], self.rows).filter(|r| (b[1]..=b[3]).contains(&self.centre(*r))) {
            for column in self.cells(b[0], b[2], self.columns).filter(|c| (b[0]..=b[2]).contains(&self.centre(*c))) {
                visit(row * self.columns + column);
            }
        }
    }

    /// Cells between the ends of a limb and within its width, with its direction.
    fn on_limb(&self, person: usize, [from, to]: [usize; 2], mut visit: impl FnMut(usize, f32, f32)) {
        let ((ax, ay), (bx, by)) = (self.place(person, from), self.place(person, to));
        let (dx, dy) = (bx - ax, by - ay);
        let length = (dx * dx + dy * dy).sqrt();
        let (ux, uy) = (dx / length.max(1e-3), dy / length.max(1e-3));
        let half = self.params.half_width_px;
        for row in self.cells(ay.min(by) - half, ay.max(by) + half, self.rows) {
            let y = self.centre(row) - ay;
            for column in self.cells(ax.min(bx) - half, ax.max(bx) + half, self.columns) {
                let x = self.centre(column) - ax;
                let (forward, sideways) = (x * ux + y * uy, x * uy - y * ux);
                if (0.0..=length).contains(&forward) && sideways.abs() <= half {
                    visit(row * self.columns + column, ux, uy);
                }
            }
        }
    }

    fn field(&self, ends: [usize; 2], paf: &mut [f32], mask: &mut [f32], count: &mut [u16]) {
        let cells = self.rows * self.columns;
        let (px, py) = paf.split_at_mut(cells);
        let (mx, my) = mask.split_at_mut(cells);
        count.fill(0);
        let mut labelled = 0;
        for person in 0..self.people() {
            let states = ends.map(|j| self.state(person, j));
            if states == [LABELLED; 2] {
                labelled += 1;
                self.on_limb(person, ends, |cell, ux, uy| {
                    px[cell] += ux;
                    py[cell] += uy;
                    count[cell] += 1;
                });
            } else if states.contains(&UNKNOWN) && !states.contains(&OUTSIDE) {
                self.in_box(person, |cell| {
                    mx[cell] = 0.0;
                    my[cell] = 0.0;
                });
            } else if !states.contains(&OUTSIDE) {
                self.on_limb(person, ends, |cell, _, _| {
                    mx[cell] = 0.0;
                    my[cell] = 0.0;
                });
            }
        }
        if labelled > 1 {
            for ((x, y), n) in px.iter_mut().zip(py).zip(count) {
                if *n > 1 {
                    *x /= f32::from(*n);
                    *y /= f32::from(*n);
                }
            }
        }
    }
}

/// `1 - max` over the joint maps.
fn background_of(parts: &[f32], background: &mut [f32], cells: usize) {
    background.fill(0.0);
    for map in parts.chunks_exact(cells) {
        for (most, value) in background.iter_mut().zip(map) {
            *most = most.max(*value);
        }
    }
    for value in background {
        *value = 1.0 - *value;
    }
}

pub(super) fn fuse_parts(own: &mut [f32], mask: &mut [f32], teacher: &[f32], cells: usize, floor: f32) {
    let joints = own.len() / cells - 1;
    let (parts, background) = own.split_at_mut(joints * cells);
    let (part_mask, background_mask) = mask.split_at_mut(joints * cells);
    for ((own, mask), teacher) in
        parts.chunks_exact_mut(cells).zip(part_mask.chunks_exact_mut(cells)).zip(teacher.chunks_exact(cells))
    {
        for (((own, mask), background_mask), teacher) in
            own.iter_mut().zip(mask).zip(background_mask.iter_mut()).zip(teacher)
        {
            *own = own.max(teacher.clamp(0.0, 1.0));
            let answered = f32::from(u8::from(*teacher >= floor));
            *mask = mask.max(answered);
            *background_mask = background_mask.max(answered);
        }
    }
    background_of(parts, background, cells);
}

pub(super) fn fuse_field(own: &mut [f32], mask: &mut [f32], teacher: &[f32], cells: usize, floor: f32) {
    let (ox, oy) = own.split_at_mut(cells);
    let (mx, my) = mask.split_at_mut(cells);
    let (tx, ty) = teacher.split_at(cells);
    let floor2 = floor * floor;
    let own = ox.iter_mut().zip(oy);
    let masks = mx.iter_mut().zip(my);
    for (((ox, oy), (mx, my)), (tx, ty)) in own.zip(masks).zip(tx.iter().zip(ty)) {
        // Squares order as norms do.
        let (ours, theirs) = (*ox * *ox + *oy * *oy, tx * tx + ty * ty);
        let take = ours <= theirs;
        *ox = if take { *tx } else { *ox };
        *oy = if take { *ty } else { *oy };
        let answered = f32::from(u8::from(theirs >= floor2));
        *mx = mx.max(answered);
        *my = my.max(answered);
    }
}
