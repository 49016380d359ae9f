//! Labels corrected by a teacher (OGG eq. 3), channel by channel.

use pulp::{Simd, WithSimd};

/// The maps of one picture, corrected.
pub(super) struct Fuse<'a> {
    pub(super) pcm: &'a mut [f32],
    pub(super) pcm_mask: &'a mut [f32],
    pub(super) paf: &'a mut [f32],
    pub(super) paf_mask: &'a mut [f32],
    pub(super) teacher_pcm: &'a [f32],
    pub(super) teacher_paf: &'a [f32],
    pub(super) cells: usize,
    pub(super) floor: f32,
}

impl WithSimd for Fuse<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        parts(self.pcm, self.pcm_mask, self.teacher_pcm, self.cells, self.floor);
        let fields = self.paf.chunks_exact_mut(2 * self.cells).zip(self.paf_mask.chunks_exact_mut(2 * self.cells));
        for ((own, mask), teacher) in fields.zip(self.teacher_paf.chunks_exact(2 * self.cells)) {
            field(own, mask, teacher, self.floor);
        }
    }
}

/// Cells that are looked at together.
const BLOCK: usize = 64;

/// Over the joints of a picture: the largest fused value, and whether the teacher answers.
pub(super) struct Most {
    value: Vec<f32>,
    answered: Vec<f32>,
}

impl Most {
    pub(super) fn new(cells: usize) -> Self {
        Self { value: vec![0.0; cells], answered: vec![0.0; cells] }
    }
}

/// One confidence map.
#[inline(always)]
pub(super) fn part(own: &mut [f32], mask: &mut [f32], teacher: &[f32], floor: f32, most: &mut Most) {
    let most = most.value.chunks_mut(BLOCK).zip(most.answered.chunks_mut(BLOCK));
    let blocks = own.chunks_mut(BLOCK).zip(mask.chunks_mut(BLOCK)).zip(teacher.chunks(BLOCK)).zip(most);
    for (((own, mask), teacher), (most, answered)) in blocks {
        for ((own, teacher), (most, answered)) in own.iter_mut().zip(teacher).zip(most.iter_mut().zip(answered)) {
            *own = larger(*own, larger(0.0, smaller(*teacher, 1.0)));
            *most = larger(*most, *own);
            *answered = larger(*answered, answer(*teacher, floor));
        }
        if !counts(mask) {
            for (mask, teacher) in mask.iter_mut().zip(teacher) {
                *mask = larger(*mask, answer(*teacher, floor));
            }
        }
    }
}

/// All confidence maps of a picture.
#[inline(always)]
pub(super) fn parts(own: &mut [f32], mask: &mut [f32], teacher: &[f32], cells: usize, floor: f32) {
    let joints = own.len() - cells;
    let (parts, own_background) = own.split_at_mut(joints);
    let (masks, background_mask) = mask.split_at_mut(joints);
    let mut most = Most::new(cells);
    let parts = parts.chunks_exact_mut(cells).zip(masks.chunks_exact_mut(cells));
    for ((own, mask), teacher) in parts.zip(teacher.chunks_exact(cells)) {
        part(own, mask, teacher, floor, &mut most);
    }
    background(own_background, background_mask, &most);
}

/// The background of the fused maps.
#[inline(always)]
pub(super) fn background(own: &mut [f32], mask: &mut [f32], most: &Most) {
    for (((own, mask), most), answered) in own.iter_mut().zip(mask).zip(&most.value).zip(&most.answered) {
        *own = 1.0 - most;
        *mask = larger(*mask, *answered);
    }
}

/// Both components of one limb.
#[inline(always)]
pub(super) fn field(own: &mut [f32], mask: &mut [f32], teacher: &[f32], floor: f32) {
    let cells = teacher.len() / 2;
    let (ox, oy) = own.split_at_mut(cells);
    let (mx, my) = mask.split_at_mut(cells);
    let (tx, ty) = teacher.split_at(cells);
    let own = ox.chunks_mut(BLOCK).zip(oy.chunks_mut(BLOCK));
    let masks = mx.chunks_mut(BLOCK).zip(my.chunks_mut(BLOCK));
    for (((ox, oy), (mx, my)), (tx, ty)) in own.zip(masks).zip(tx.chunks(BLOCK).zip(ty.chunks(BLOCK))) {
        for ((ox, oy), (tx, ty)) in ox.iter_mut().zip(oy).zip(tx.iter().zip(ty)) {
            // Squares order as norms do.
            let take = *ox * *ox + *oy * *oy <= tx * tx + ty * ty;
            *ox = if take { *tx } else { *ox };
            *oy = if take { *ty } else { *oy };
        }
        for mask in [mx, my] {
            if !counts(mask) {
                for (mask, (tx, ty)) in mask.iter_mut().zip(tx.iter().zip(ty)) {
                    *mask = larger(*mask, answer(tx * tx + ty * ty, floor * floor));
                }
            }
        }
    }
}

/// True where a mask leaves nothing out, so that it need not be written: half of what fusion would write are masks.
#[inline(always)]
fn counts(mask: &[f32]) -> bool {
    mask.iter().fold(1.0, |least, mask| smaller(least, *mask)) >= 1.0
}

/// 1 where the teacher answers.
#[inline(always)]
fn answer(response: f32, floor: f32) -> f32 {
    if response >= floor { 1.0 } else { 0.0 }
}

/// The larger; `a` where `b` is no number. One instruction, unlike `f32::max`.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The smaller; `a` where `b` is no number.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}
