//! Pictures, maps and labels from formulas; `peers.py` has the same formulas.

use pose::{Keypoint, Layout, OpenPoseSpec, Person, Skeleton};

pub(crate) fn picture(width: usize, height: usize) -> Vec<u8> {
    (0..width * height * 3).map(|i| ((i * 7919) >> 4) as u8).collect()
}

/// Reproducible values in -0.2 .. 1.
pub(crate) fn noise(n: usize) -> Vec<f32> {
    (0..n).map(|i| (i * 7919 % 1000) as f32 / 833.0 - 0.2).collect()
}

/// Joints in a 368 px square and the boxes around them: `(batch, people, 18, 2)` and `(batch, people, 4)`.
pub(crate) fn labels(batch: usize, people: usize) -> (Vec<f32>, Vec<f32>) {
    let n = batch * people;
    let joints = (0..n * 36).map(|i| (i * 7919 % 3680) as f32 / 10.0).collect();
    (joints, [0.0, 0.0, 367.0, 367.0].repeat(n))
}

const BODY: [(f32, f32); 18] = [
    (0.0, -2.0),
    (0.0, 0.0),
    (-1.6, 0.0),
    (-2.0, 3.0),
    (-2.2, 6.0),
    (1.6, 0.0),
    (2.0, 3.0),
    (2.2, 6.0),
    (-1.0, 6.5),
    (-1.0, 11.0),
    (-1.0, 15.0),
    (1.0, 6.5),
    (1.0, 11.0),
    (1.0, 15.0),
    (-0.5, -2.6),
    (0.5, -2.6),
    (-1.1, -2.2),
    (1.1, -2.2),
];

/// Confidence maps and fields of people who stand in two rows.
pub(crate) fn maps(
    people: usize,
    spec: &OpenPoseSpec,
    skeleton: Skeleton,
    width: usize,
    height: usize,
    layout: Layout,
) -> (Vec<f32>, Vec<f32>) {
    let mut pcm = vec![0.0_f32; 19 * width * height];
    let mut paf = vec![0.0_f32; 38 * width * height];
    let index = |c: usize, n: usize, x: usize, y: usize| match layout {
        Layout::Nchw => (c * height + y) * width + x,
        Layout::Nhwc => (y * width + x) * n + c,
    };
    for p in 0..people {
        let (x0, y0) = (5.0 + 10.4 * (p % 5) as f32, 4.3 + 22.0 * (p / 5) as f32);
        let joints: Vec<_> = BODY.iter().map(|(x, y)| (x0 + x * 1.4, y0 + y * 1.2)).collect();
        for y in 0..height {
            for x in 0..width {
                for (j, (jx, jy)) in joints.iter().enumerate() {
                    let d2 = (x as f32 - jx).powi(2) + (y as f32 - jy).powi(2);
                    let cell = &mut pcm[index(j, 19, x, y)];
                    *cell = cell.max((-d2 / 1.6).exp());
                }
                for limb in &spec.limbs {
                    let end = |part| joints[skeleton.index_of(part).unwrap()];
                    let ((ax, ay), (bx, by)) = (end(limb.from), end(limb.to));
                    let (dx, dy) = (bx - ax, by - ay);
                    let length = dx.hypot(dy);
                    let (px, py) = (x as f32 - ax, y as f32 - ay);
                    let (along, across) = ((px * dx + py * dy) / length, (px * dy - py * dx) / length);
                    if (-0.5..=length + 0.5).contains(&along) && across.abs() <= 1.0 {
                        paf[index(limb.paf[0], 38, x, y)] = dx / length;
                        paf[index(limb.paf[1], 38, x, y)] = dy / length;
                    }
                }
            }
        }
    }
    (pcm, paf)
}

/// People of the OpenPose order side by side.
pub(crate) fn people(n: usize) -> Vec<Person> {
    (0..n)
        .map(|p| Person {
            skeleton: Skeleton::OpenPose18,
            keypoints: BODY
                .iter()
                .map(|(x, y)| {
                    Some(Keypoint { u_px: 200.0 + 300.0 * p as f32 + 30.0 * x, v_px: 150.0 + 30.0 * y, score: 0.8 })
                })
                .collect(),
            score: 0.8,
        })
        .collect()
}
