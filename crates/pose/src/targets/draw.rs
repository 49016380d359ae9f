//! The targets of one picture, drawn channel by channel, each emptied before and corrected by the teacher's after, all while it
//! lies in the first cache. Labels are drawn a register of cells at a time.

use std::ops::Range;

use pulp::NullaryFnOnce;

use super::{
    JointState, TargetParams,
    fuse::{self, LANES},
    shape::{Axis, Bell, Line, Runs, larger},
};

/// A hidden joint is left out within this many sigmas.
const MASK_RADIUS: f32 = 3.0;

const UNKNOWN: u8 = JointState::Unknown as u8;
const HIDDEN: u8 = JointState::Hidden as u8;
const OUTSIDE: u8 = JointState::Outside as u8;
const LABELLED: u8 = JointState::Labelled as u8;

pub(super) struct Sample<'a> {
    pub(super) params: &'a TargetParams,
    pub(super) ends: &'a [[usize; 2]],
    pub(super) rows: Axis,
    pub(super) columns: Axis,
    pub(super) joints_px: &'a [f32],
    pub(super) states: &'a [u8],
    pub(super) boxes_px: &'a [f32],
    /// The teacher's maps and fields, and its floor.
    pub(super) teacher: Option<(&'a [f32], &'a [f32], f32)>,
}

/// A picture's labels and where its maps go, to be drawn with the widest registers there are.
pub(super) struct Picture<'a> {
    pub(super) sample: Sample<'a>,
    pub(super) pcm: &'a mut [f32],
    pub(super) pcm_mask: &'a mut [bool],
    pub(super) paf: &'a mut [f32],
    pub(super) paf_mask: &'a mut [bool],
}

impl NullaryFnOnce for Picture<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        if self.sample.columns.cells < LANES { self.draw::<1>() } else { self.draw::<LANES>() }
    }
}

impl Picture<'_> {
    #[inline(always)]
    fn draw<const N: usize>(self) {
        self.pcm_mask.fill(true);
        self.paf_mask.fill(true);
        self.sample.parts::<N>(self.pcm, self.pcm_mask);
        self.sample.fields::<N>(self.paf, self.paf_mask);
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

    #[inline(always)]
    fn bell(&self, person: usize, joint: usize) -> Bell {
        Bell::new(self.place(person, joint), self.params.sigma_px, self.rows, self.columns)
    }

    #[inline(always)]
    fn line(&self, person: usize, [from, to]: [usize; 2]) -> Line {
        Line::new(self.place(person, from), self.place(person, to), self.params.half_width_px, self.rows, self.columns)
    }

    /// Confidence maps and background.
    #[inline(always)]
    fn parts<const N: usize>(&self, pcm: &mut [f32], mask: &mut [bool]) {
        let cells = self.rows.cells * self.columns.cells;
        let (pcm, background) = pcm.split_at_mut(self.joints() * cells);
        let (mask, background_mask) = mask.split_at_mut(self.joints() * cells);
        let mut teacher = self.teacher.map(|(teacher, _, floor)| (teacher, floor, fuse::Most::new(cells)));
        // `background` is the most of all labels until all are drawn.
        background.fill(0.0);
        for (joint, (map, mask)) in pcm.chunks_exact_mut(cells).zip(mask.chunks_exact_mut(cells)).enumerate() {
            map.fill(0.0);
            for person in 0..self.people() {
                match self.state(person, joint) {
                    LABELLED => self.draw_joint::<N>(&self.bell(person, joint), map, background),
                    HIDDEN => self.hide_joint(&self.bell(person, joint), mask, background_mask),
                    UNKNOWN => self.in_box(person, |run| mask[run].fill(false)),
                    _ => {}
                }
            }
            if let Some((teacher, floor, most)) = &mut teacher {
                fuse::part(map, mask, &teacher[joint * cells..][..cells], *floor, most);
            }
        }
        for most in &mut *background {
            *most = 1.0 - *most;
        }
        for person in 0..self.people() {
            if (0..self.joints()).any(|j| self.state(person, j) == UNKNOWN) {
                self.in_box(person, |run| {
                    for (mask, background) in background_mask[run.clone()].iter_mut().zip(&background[run]) {
                        *mask &= *background <= 0.5;
                    }
                });
            }
        }
        if let Some((_, _, most)) = &teacher {
            fuse::background(background, background_mask, most);
        }
    }

    #[inline(always)]
    fn draw_joint<const N: usize>(&self, bell: &Bell, map: &mut [f32], most: &mut [f32]) {
        let (rows, columns) = (self.rows, self.columns);
        for run in Runs::<N>::new(bell.columns.clone(), columns) {
            let mut across = [0.0; N];
            for (i, across) in across.iter_mut().enumerate().filter(|(i, _)| run.has(*i)) {
                *across = bell.across(columns.centre(run.first + i));
            }
            for row in bell.rows.clone() {
                let down = bell.down(rows.centre(row));
                let first = row * columns.cells + run.first;
                let (map, most) = (lanes::<N>(map, first), lanes::<N>(most, first));
                let (mut a, mut b) = (*map, *most);
                for i in 0..N {
                    a[i] = larger(a[i], down * across[i]);
                    b[i] = larger(b[i], down * across[i]);
                }
                (*map, *most) = (a, b);
            }
        }
    }

    #[inline(always)]
    fn hide_joint(&self, bell: &Bell, mask: &mut [bool], background_mask: &mut [bool]) {
        let edge = (-MASK_RADIUS * MASK_RADIUS / 2.0).exp();
        let (rows, columns) = (self.rows, self.columns);
        for row in bell.rows.clone() {
            let down = bell.down(rows.centre(row));
            for column in bell.columns.clone() {
                if down * bell.across(columns.centre(column)) > edge {
                    mask[row * columns.cells + column] = false;
                    background_mask[row * columns.cells + column] = false;
                }
            }
        }
    }

    /// Affinity fields.
    #[inline(always)]
    fn fields<const N: usize>(&self, paf: &mut [f32], mask: &mut [bool]) {
        let cells = self.rows.cells * self.columns.cells;
        let centres: Vec<f32> = (0..self.columns.cells).map(|c| self.columns.centre(c)).collect();
        let mut people = vec![0.0; cells];
        let maps = paf.chunks_exact_mut(2 * cells).zip(mask.chunks_exact_mut(2 * cells));
        for (limb, (ends, (paf, mask))) in self.ends.iter().zip(maps).enumerate() {
            paf.fill(0.0);
            people.fill(0.0);
            for person in 0..self.people() {
                let states = ends.map(|j| self.state(person, j));
                if states.contains(&OUTSIDE) {
                    continue;
                }
                let (mx, my) = mask.split_at_mut(cells);
                if states == [LABELLED; 2] {
                    self.draw_limb::<N>(&self.line(person, *ends), paf, &mut people, &centres);
                } else if states.contains(&UNKNOWN) {
                    self.in_box(person, |run| {
                        mx[run.clone()].fill(false);
                        my[run].fill(false);
                    });
                } else {
                    self.hide_limb(&self.line(person, *ends), mx, my);
                }
            }
            if let Some((_, teacher, floor)) = self.teacher {
                fuse::field(paf, mask, &teacher[limb * 2 * cells..][..2 * cells], floor);
            }
        }
    }

    /// Adds a limb to the mean over the `people` in each cell so far. `centres` are those of the columns.
    #[inline(always)]
    fn draw_limb<const N: usize>(&self, line: &Line, paf: &mut [f32], people: &mut [f32], centres: &[f32]) {
        let (px, py) = paf.split_at_mut(people.len());
        for run in Runs::<N>::new(line.columns.clone(), self.columns) {
            let centres = &centres[run.first..][..N];
            for row in line.rows.clone() {
                let y = self.rows.centre(row);
                let first = row * self.columns.cells + run.first;
                let (px, py) = (lanes::<N>(px, first), lanes::<N>(py, first));
                let people = lanes::<N>(people, first);
                let (mut a, mut b, mut n) = (*px, *py, *people);
                for (i, x) in centres.iter().enumerate() {
                    let one = if run.has(i) && line.covers(*x, y) { 1.0 } else { 0.0 };
                    let share = one / (n[i] + 1.0);
                    a[i] += (line.ux - a[i]) * share;
                    b[i] += (line.uy - b[i]) * share;
                    n[i] += one;
                }
                (*px, *py, *people) = (a, b, n);
            }
        }
    }

    #[inline(always)]
    fn hide_limb(&self, line: &Line, mx: &mut [bool], my: &mut [bool]) {
        for row in line.rows.clone() {
            let y = self.rows.centre(row);
            for column in line.columns.clone().filter(|c| line.covers(self.columns.centre(*c), y)) {
                mx[row * self.columns.cells + column] = false;
                my[row * self.columns.cells + column] = false;
            }
        }
    }

    /// The runs of cells of a person's box.
    #[inline(always)]
    fn in_box(&self, person: usize, mut visit: impl FnMut(Range<usize>)) {
        let b = &self.boxes_px[person * 4..person * 4 + 4];
        let columns = self.columns.inside(b[0], b[2]);
        for row in self.rows.inside(b[1], b[3]) {
            let first = row * self.columns.cells;
            visit(first + columns.start..first + columns.end);
        }
    }
}

/// `N` numbers from `first` on, which there are.
#[inline(always)]
fn lanes<const N: usize>(numbers: &mut [f32], first: usize) -> &mut [f32; N] {
    match numbers[first..].first_chunk_mut() {
        Some(lanes) => lanes,
        None => unreachable!("a run ends in its row"),
    }
}
