//! Labels corrected by a teacher (OGG eq. 3), channel by channel.

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
pub(super) fn part(own: &mut [f32], mask: &mut [f32], teacher: &[f32], floor: f32, most: &mut Most) {
    let most = most.value.iter_mut().zip(&mut most.answered);
    for (((own, mask), teacher), (most, answered)) in own.iter_mut().zip(mask).zip(teacher).zip(most) {
        *own = larger(*own, larger(0.0, smaller(*teacher, 1.0)));
        *most = larger(*most, *own);
        let answer = if *teacher >= floor { 1.0 } else { 0.0 };
        *mask = larger(*mask, answer);
        *answered = larger(*answered, answer);
    }
}

/// All confidence maps of a picture.
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
pub(super) fn background(own: &mut [f32], mask: &mut [f32], most: &Most) {
    for (((own, mask), most), answered) in own.iter_mut().zip(mask).zip(&most.value).zip(&most.answered) {
        *own = 1.0 - most;
        *mask = larger(*mask, *answered);
    }
}

/// Both components of one limb.
pub(super) fn field(own: &mut [f32], mask: &mut [f32], teacher: &[f32], floor: f32) {
    let cells = teacher.len() / 2;
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
        let answer = if theirs >= floor2 { 1.0 } else { 0.0 };
        *mx = larger(*mx, answer);
        *my = larger(*my, answer);
    }
}

/// The larger; `a` where `b` is no number. One instruction, unlike `f32::max`.
fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The smaller; `a` where `b` is no number.
fn smaller(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}
