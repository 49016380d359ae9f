//! Labels corrected by a teacher (OGG eq. 3), channel by channel.

use pulp::NullaryFnOnce;

use super::shape::{larger, smaller};

/// Cells that are corrected together: the numbers of one AVX-512 register.
pub(super) const LANES: usize = 16;

/// The maps of one picture, its teacher's and the floor, to be corrected with the widest registers there are.
pub(super) struct Picture<'a> {
    pub(super) pcm: &'a mut [f32],
    pub(super) pcm_mask: &'a mut [bool],
    pub(super) paf: &'a mut [f32],
    pub(super) paf_mask: &'a mut [bool],
    pub(super) teacher: (&'a [f32], &'a [f32]),
    pub(super) cells: usize,
    pub(super) floor: f32,
}

impl NullaryFnOnce for Picture<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (cells, (pcm, paf)) = (self.cells, self.teacher);
        parts(self.pcm, self.pcm_mask, pcm, cells, self.floor);
        let fields = self.paf.chunks_exact_mut(2 * cells).zip(self.paf_mask.chunks_exact_mut(2 * cells));
        for ((own, mask), teacher) in fields.zip(paf.chunks_exact(2 * cells)) {
            field(own, mask, teacher, self.floor);
        }
    }
}

/// Over the joints of a picture: the largest fused value, and whether the teacher answers.
pub(super) struct Most {
    value: Vec<f32>,
    answered: Vec<bool>,
}

impl Most {
    pub(super) fn new(cells: usize) -> Self {
        Self { value: vec![0.0; cells], answered: vec![false; cells] }
    }
}

/// One confidence map.
#[inline(always)]
pub(super) fn part(own: &mut [f32], mask: &mut [bool], teacher: &[f32], floor: f32, most: &mut Most) {
    let most = most.value.iter_mut().zip(&mut most.answered);
    for (((own, mask), teacher), (most, answered)) in own.iter_mut().zip(mask).zip(teacher).zip(most) {
        *own = larger(*own, larger(0.0, smaller(*teacher, 1.0)));
        *most = larger(*most, *own);
        let answer = *teacher >= floor;
        *mask |= answer;
        *answered |= answer;
    }
}

/// All confidence maps of a picture.
#[inline(always)]
pub(super) fn parts(own: &mut [f32], mask: &mut [bool], teacher: &[f32], cells: usize, floor: f32) {
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
pub(super) fn background(own: &mut [f32], mask: &mut [bool], most: &Most) {
    for (((own, mask), most), answered) in own.iter_mut().zip(mask).zip(&most.value).zip(&most.answered) {
        *own = 1.0 - most;
        *mask |= *answered;
    }
}

/// Both components of one limb.
#[inline(always)]
pub(super) fn field(own: &mut [f32], mask: &mut [bool], teacher: &[f32], floor: f32) {
    let cells = teacher.len() / 2;
    let (own, mask, teacher) = (own.split_at_mut(cells), mask.split_at_mut(cells), teacher.split_at(cells));
    let ((ox, ox_rest), (oy, oy_rest)) = (own.0.as_chunks_mut(), own.1.as_chunks_mut());
    let ((mx, mx_rest), (my, my_rest)) = (mask.0.as_chunks_mut(), mask.1.as_chunks_mut());
    let ((tx, tx_rest), (ty, ty_rest)) = (teacher.0.as_chunks(), teacher.1.as_chunks());
    for (((ox, oy), (mx, my)), (tx, ty)) in ox.iter_mut().zip(oy).zip(mx.iter_mut().zip(my)).zip(tx.iter().zip(ty)) {
        vectors::<LANES>([ox, oy], [mx, my], [tx, ty], floor);
    }
    let (ox, oy) = (ox_rest.iter_mut(), oy_rest.iter_mut());
    let (mx, my) = (mx_rest.iter_mut(), my_rest.iter_mut());
    for (((ox, oy), (mx, my)), (tx, ty)) in ox.zip(oy).zip(mx.zip(my)).zip(tx_rest.iter().zip(ty_rest)) {
        let (own, mask) = ([ox, oy].map(std::array::from_mut), [mx, my].map(std::array::from_mut));
        vectors(own, mask, [tx, ty].map(std::array::from_ref), floor);
    }
}

/// `N` cells of a limb: components of the label, their mask, components of the teacher. All is worked out before the first
/// result is stored, so that the compiler need not fear that arrays overlap.
#[inline(always)]
fn vectors<const N: usize>(
    [ox, oy]: [&mut [f32; N]; 2],
    [mx, my]: [&mut [bool; N]; 2],
    [tx, ty]: [&[f32; N]; 2],
    floor: f32,
) {
    let floor2 = floor * floor;
    let (mut x, mut y, mut a, mut b) = ([0.0; N], [0.0; N], [false; N], [false; N]);
    for i in 0..N {
        let (ours, theirs) = (ox[i] * ox[i] + oy[i] * oy[i], tx[i] * tx[i] + ty[i] * ty[i]);
        let take = ours <= theirs;
        x[i] = if take { tx[i] } else { ox[i] };
        y[i] = if take { ty[i] } else { oy[i] };
        let answer = theirs >= floor2;
        a[i] = mx[i] | answer;
        b[i] = my[i] | answer;
    }
    (*ox, *oy, *mx, *my) = (x, y, a, b);
}
