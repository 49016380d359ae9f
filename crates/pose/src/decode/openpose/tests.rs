use proptest::prelude::*;

use super::*;
use crate::{Part, card::Model};

mod rules;

const W: usize = 60;
const H: usize = 46;
const STRIDE: f32 = 8.0;

/// A standing person of 24 cells height, joints of the COCO-18 order in cells, moved by `(x, y)`.
fn body(x: f32, y: f32) -> Vec<(f32, f32)> {
    let shape = [
        (0.0, -2.0),
        (0.0, 0.0),
        (-3.0, 0.0),
        (-4.0, 4.0),
        (-4.5, 8.0),
        (3.0, 0.0),
        (4.0, 4.0),
        (4.5, 8.0),
        (-2.0, 9.0),
        (-2.0, 15.0),
        (-2.0, 21.0),
        (2.0, 9.0),
        (2.0, 15.0),
        (2.0, 21.0),
        (-0.7, -3.0),
        (0.7, -3.0),
        (-1.6, -2.5),
        (1.6, -2.5),
    ];
    shape.iter().map(|(dx, dy)| (x + dx, y + dy)).collect()
}

struct Scene {
    pcm: Vec<f32>,
    paf: Vec<f32>,
}

/// Maps drawn by their definition, independent of the target encoder: Gaussians of 0.9 cells, fields one cell to each side.
fn draw(people: &[Vec<(f32, f32)>], spec: &OpenPoseSpec, skeleton: Skeleton, layout: Layout) -> Scene {
    let (jc, lc) = (spec.pcm.channels, spec.paf.channels);
    let index = |c: usize, n: usize, x: usize, y: usize| match layout {
        Layout::Nchw => (c * H + y) * W + x,
        Layout::Nhwc => (y * W + x) * n + c,
    };
    let mut scene = Scene { pcm: vec![0.0; jc * W * H], paf: vec![0.0; lc * W * H] };
    for person in people {
        for y in 0..H {
            for x in 0..W {
                for (j, (jx, jy)) in person.iter().enumerate() {
                    let d2 = (x as f32 - jx).powi(2) + (y as f32 - jy).powi(2);
                    let cell = &mut scene.pcm[index(j, jc, x, y)];
                    *cell = cell.max((-d2 / (2.0 * 0.9 * 0.9)).exp());
                }
                for limb in &spec.limbs {
                    let (ax, ay) = person[skeleton.index_of(limb.from).unwrap()];
                    let (bx, by) = person[skeleton.index_of(limb.to).unwrap()];
                    let (dx, dy) = (bx - ax, by - ay);
                    let length = dx.hypot(dy);
                    let (px, py) = (x as f32 - ax, y as f32 - ay);
                    let along = (px * dx + py * dy) / length;
                    let across = (px * dy - py * dx) / length;
                    if (-0.5..=length + 0.5).contains(&along) && across.abs() <= 1.0 {
                        scene.paf[index(limb.paf[0], lc, x, y)] = dx / length;
                        scene.paf[index(limb.paf[1], lc, x, y)] = dy / length;
                    }
                }
            }
        }
    }
    scene
}

fn decode(scene: &Scene, layout: Layout) -> Vec<Person> {
    let card = Model::builtin_cards().into_iter().find(|c| c.output == crate::OutputKind::OpenPose).unwrap();
    let spec = card.openpose.unwrap();
    let mut decoder = OpenPoseDecoder::new(card.skeleton, &spec, 0.1);
    let view = |data, channels| MapView { data, layout, channels, first: 0, width: W, height: H };
    decoder.decode(view(&scene.pcm, spec.pcm.channels), view(&scene.paf, spec.paf.channels))
}

fn spec() -> OpenPoseSpec {
    Model::builtin_cards().into_iter().find_map(|c| c.openpose).unwrap()
}

/// Which drawn person a decoded one is, with every keypoint within a tenth of a cell; `None` if it mixes two.
fn identity(person: &Person, drawn: &[Vec<(f32, f32)>]) -> Option<usize> {
    drawn.iter().position(|joints| {
        person.keypoints.iter().zip(joints).all(|(k, (x, y))| {
            k.is_some_and(|k| {
                ((k.u_px + 0.5) / STRIDE - 0.5 - x).abs() < 0.1 && ((k.v_px + 0.5) / STRIDE - 0.5 - y).abs() < 0.1
            })
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Judge: the scene that was drawn. Every person comes back whole and unmixed, in both memory orders.
    #[test]
    fn people_who_stand_apart_come_back_whole(
        x0 in 5.0..8.0_f32, dx1 in 11.0..14.0_f32, dx2 in 11.0..14.0_f32, dx3 in 11.0..12.0_f32,
        y in proptest::array::uniform4(4.0..22.0_f32), n in 1..=4_usize,
    ) {
        let xs = [x0, x0 + dx1, x0 + dx1 + dx2, x0 + dx1 + dx2 + dx3];
        let drawn: Vec<_> = (0..n).map(|i| body(xs[i], y[i])).collect();
        for layout in [Layout::Nchw, Layout::Nhwc] {
            let people = decode(&draw(&drawn, &spec(), Skeleton::OpenPose18, layout), layout);
            prop_assert_eq!(people.len(), n);
            let mut found: Vec<_> = people.iter().map(|p| identity(p, &drawn)).collect();
            found.sort_unstable();
            prop_assert_eq!(found, (0..n).map(Some).collect::<Vec<_>>());
        }
    }

    /// Judge: all permutations of the second parts. Greedy matching finds the best total where limbs do not overlap.
    #[test]
    fn matching_equals_the_best_assignment_of_small_scenes(
        ends in proptest::collection::vec((3.0..56.0_f32, 3.0..42.0_f32, 0.0..std::f32::consts::TAU, 5.0..9.0_f32), 2..=5),
    ) {
        let limbs: Vec<_> = ends
            .iter()
            .map(|&(x, y, angle, length)| ((x, y), (x + length * angle.cos(), y + length * angle.sin())))
            .collect();
        let apart = |a: (f32, f32), b: (f32, f32)| (a.0 - b.0).hypot(a.1 - b.1) > 4.0;
        let on_line = |l: &((f32, f32), (f32, f32)), u: f32| (l.0.0 + u * (l.1.0 - l.0.0), l.0.1 + u * (l.1.1 - l.0.1));
        let points = |l| (0..5).map(|i| on_line(l, i as f32 / 4.0)).collect::<Vec<_>>();
        for i in 0..limbs.len() {
            prop_assume!((3.0..57.0).contains(&limbs[i].1.0) && (3.0..43.0).contains(&limbs[i].1.1));
            for j in 0..i {
                let (a, b) = (points(&limbs[i]), points(&limbs[j]));
                prop_assume!(a.iter().all(|p| b.iter().all(|q| apart(*p, *q))));
            }
        }
        let spec = spec();
        let limb = spec.limbs[2];
        let (from, to) = (2, 3);
        let people: Vec<Vec<(f32, f32)>> = limbs
            .iter()
            .map(|l| {
                let mut joints = vec![(-50.0, -50.0); 18];
                joints[from] = l.0;
                joints[to] = l.1;
                joints
            })
            .collect();
        let only = OpenPoseSpec { limbs: vec![limb], ..spec.clone() };
        let scene = draw(&people, &only, Skeleton::OpenPose18, Layout::Nchw);
        let mut decoder = OpenPoseDecoder::new(Skeleton::OpenPose18, &only, 0.1);
        let view = |data, channels| MapView { data, layout: Layout::Nchw, channels, first: 0, width: W, height: H };
        decoder.decode(view(&scene.pcm, 19), view(&scene.paf, 38));
        let paf = view(&scene.paf, 38);
        let field = Field { maps: paf, channels: limb.paf };
        let matched = decoder.match_up(&decoder.supported(field, from, to, H), [from, to]);

        let (a, b) = (&decoder.peaks()[from], &decoder.peaks()[to]);
        prop_assert_eq!((a.len(), b.len()), (limbs.len(), limbs.len()));
        let value = |i: usize, j: usize| {
            let length = (a[i].x - b[j].x).hypot(a[i].y - b[j].y);
            let penalty = (0.5 * H as f32 / length - 1.0).min(0.0);
            field.line(a[i], b[j], 0.05).0 + penalty + 0.1 * (a[i].score + b[j].score)
        };
        let mut best = (f32::MIN, Vec::new());
        permutations(limbs.len(), &mut |p| {
            let total: f32 = p.iter().enumerate().map(|(i, &j)| value(i, j)).sum();
            if total > best.0 {
                best = (total, p.to_vec());
            }
        });
        prop_assert_eq!(matched.len(), limbs.len());
        for c in &matched {
            prop_assert_eq!(best.1[c.from], c.to);
        }
    }
}

/// The definition of greedy matching, pair by pair, on maps of pure noise: the best pair that is left, until none is. The
/// line integrals are made here, in 64-bit floats.
fn greedy_by_definition(
    (a, b): (&[Peak], &[Peak]),
    field: impl Fn(f64, f64) -> [f64; 2],
    height: usize,
) -> Vec<(usize, usize)> {
    let mut left: Vec<(usize, usize, f64)> = Vec::new();
    for (i, p) in a.iter().enumerate() {
        for (j, q) in b.iter().enumerate() {
            let (dx, dy) = (f64::from(q.x - p.x), f64::from(q.y - p.y));
            let length = dx.hypot(dy);
            let values: Vec<f64> = (0..10)
                .map(|k| {
                    let u = f64::from(k) / 9.0;
                    let [lx, ly] = field(f64::from(p.x) + u * dx, f64::from(p.y) + u * dy);
                    (lx * dx + ly * dy) / length
                })
                .collect();
            let support = values.iter().filter(|v| **v >= 0.05).count();
            let score = values.iter().sum::<f64>() / 10.0 + (0.5 * height as f64 / length - 1.0).min(0.0);
            if support >= 8 && score > 0.0 {
                left.push((i, j, score + 0.1 * f64::from(p.score + q.score)));
            }
        }
    }
    let mut matched = Vec::new();
    while let Some(best) = left.iter().copied().reduce(|x, y| if y.2 > x.2 { y } else { x }) {
        matched.push((best.0, best.1));
        left.retain(|x| x.0 != best.0 && x.1 != best.1);
    }
    matched
}

#[test]
fn matching_in_noise_is_greedy_matching_by_its_definition() {
    let mut state = 7_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    };
    let spec = spec();
    let limb = spec.limbs[2];
    let only = OpenPoseSpec { limbs: vec![limb], peak_threshold: 0.9, ..spec };
    let mut matches = 0;
    for scene in 0..300 {
        // A field that varies slowly, so that lines have support; parts wherever the noise has a peak.
        let (kx, ky, phase) = (0.3 * uniform() - 0.15, 0.3 * uniform() - 0.15, 6.3 * uniform());
        let pcm: Vec<f32> = (0..19 * W * H).map(|_| uniform().powf(0.2)).collect();
        let mut paf = vec![0.0; 38 * W * H];
        for y in 0..H {
            for x in 0..W {
                let angle = kx * x as f32 + ky * y as f32 + phase + 0.2 * uniform();
                paf[(limb.paf[0] * H + y) * W + x] = angle.cos();
                paf[(limb.paf[1] * H + y) * W + x] = angle.sin();
            }
        }
        let view = |data, channels| MapView { data, layout: Layout::Nchw, channels, first: 0, width: W, height: H };
        let mut decoder = OpenPoseDecoder::new(Skeleton::OpenPose18, &only, 0.1);
        decoder.decode(view(&pcm, 19), view(&paf, 38));
        let at = |c: usize, x: usize, y: usize| f64::from(paf[(limb.paf[c] * H + y) * W + x]);
        let field = |x: f64, y: f64| {
            let (x, y) = (x.clamp(0.0, (W - 1) as f64), y.clamp(0.0, (H - 1) as f64));
            let (x0, y0) = (x.floor() as usize, y.floor() as usize);
            let (x1, y1) = ((x0 + 1).min(W - 1), (y0 + 1).min(H - 1));
            let (fx, fy) = (x - x0 as f64, y - y0 as f64);
            [0, 1].map(|c| {
                (at(c, x0, y0) * (1.0 - fx) + at(c, x1, y0) * fx) * (1.0 - fy)
                    + (at(c, x0, y1) * (1.0 - fx) + at(c, x1, y1) * fx) * fy
            })
        };
        let (from, to) = (2, 3);
        let expected = greedy_by_definition((&decoder.peaks()[from], &decoder.peaks()[to]), field, H);
        let field = Field { maps: view(&paf, 38), channels: limb.paf };
        let got = decoder.match_up(&decoder.supported(field, from, to, H), [from, to]);
        assert_eq!(got.iter().map(|c| (c.from, c.to)).collect::<Vec<_>>(), expected, "scene {scene}");
        matches += got.len();
    }
    assert!(matches > 3000, "{matches}");
}

fn permutations(n: usize, visit: &mut impl FnMut(&[usize])) {
    fn step(prefix: &mut Vec<usize>, n: usize, visit: &mut impl FnMut(&[usize])) {
        if prefix.len() == n {
            visit(prefix);
        }
        for i in 0..n {
            if !prefix.contains(&i) {
                prefix.push(i);
                step(prefix, n, visit);
                prefix.pop();
            }
        }
    }
    step(&mut Vec::new(), n, visit);
}

/// The mean of a constant field along a line is its dot product with the direction: closed form.
#[test]
fn the_line_integral_of_a_constant_field_is_a_dot_product() {
    let data: Vec<f32> = [0.6_f32, -0.3].iter().flat_map(|v| vec![*v; W * H]).collect();
    let maps = MapView { data: &data, layout: Layout::Nchw, channels: 2, first: 0, width: W, height: H };
    let field = Field { maps, channels: [0, 1] };
    let at = |x, y| Peak { x, y, score: 1.0 };
    let (mean, support) = field.line(at(10.0, 10.0), at(13.0, 14.0), 0.1);
    assert!((mean - (0.6 * 0.6 - 0.3 * 0.8)).abs() < 1e-6);
    assert!((support - 1.0).abs() < 1e-6);
    assert!(field.line(at(13.0, 14.0), at(10.0, 10.0), 0.1).1 < 1e-6);
}

#[test]
fn an_empty_or_constant_scene_is_nobody() {
    let empty = Scene { pcm: vec![0.0; 19 * W * H], paf: vec![0.0; 38 * W * H] };
    assert!(decode(&empty, Layout::Nchw).is_empty());
    let flat = Scene { pcm: vec![0.5; 19 * W * H], paf: vec![0.0; 38 * W * H] };
    assert!(decode(&flat, Layout::Nchw).is_empty());
}

/// Two people whose arms touch: only the fields tell whose wrist is whose.
#[test]
fn touching_people_keep_their_own_wrists() {
    let left = body(15.0, 8.0);
    let mut right = body(26.0, 8.0);
    right[Skeleton::OpenPose18.index_of(Part::RightWrist).unwrap()] = (21.5, 12.0);
    let drawn = [left, right];
    let people = decode(&draw(&drawn, &spec(), Skeleton::OpenPose18, Layout::Nhwc), Layout::Nhwc);
    let mut found: Vec<_> = people.iter().map(|p| identity(p, &drawn)).collect();
    found.sort_unstable();
    assert_eq!(found, [Some(0), Some(1)]);
}

/// A faint second maximum on the forearm, and a field that is weaker at its end: the field alone prefers the faint one.
#[test]
fn a_faint_maximum_on_a_limb_does_not_become_its_end() {
    let mut person = body(30.0, 10.0);
    person[4] = (25.0, 24.0);
    let mut scene = draw(std::slice::from_ref(&person), &spec(), Skeleton::OpenPose18, Layout::Nchw);
    for y in 0..H {
        for x in 0..W {
            let d2 = (x as f32 - 25.0).powi(2) + (y as f32 - 20.0).powi(2);
            let cell = &mut scene.pcm[(4 * H + y) * W + x];
            *cell = cell.max(0.4 * (-d2 / 1.6).exp());
            for channel in [16, 17] {
                if y > 21 {
                    scene.paf[(channel * H + y) * W + x] *= 0.85;
                }
            }
        }
    }
    let people = decode(&scene, Layout::Nchw);
    assert_eq!(people.len(), 1);
    let wrist = people[0].get(Part::RightWrist).unwrap();
    assert!(((wrist.v_px + 0.5) / STRIDE - 0.5 - 24.0).abs() < 0.1, "{wrist:?}");
}

/// A field from one person's neck to the shoulder of somebody far away, as a row of people between them makes it.
#[test]
fn a_limb_across_the_picture_joins_nobody() {
    let (near, mut far) = (body(12.0, 8.0), body(50.0, 10.0));
    let shoulder = Skeleton::OpenPose18.index_of(Part::LeftShoulder).unwrap();
    let mut one_shouldered = near.clone();
    one_shouldered[shoulder] = (-50.0, -50.0);
    // Only a shoulder and an arm of the other one are there.
    for (i, joint) in far.iter_mut().enumerate() {
        if !(5..8).contains(&i) {
            *joint = (-50.0, -50.0);
        }
    }
    let mut scene = draw(&[one_shouldered.clone(), far.clone()], &spec(), Skeleton::OpenPose18, Layout::Nchw);
    let (neck, elsewhere) = (one_shouldered[1], far[shoulder]);
    let (dx, dy) = (elsewhere.0 - neck.0, elsewhere.1 - neck.1);
    let length = dx.hypot(dy);
    for y in 0..H {
        for x in 0..W {
            let across = ((x as f32 - neck.0) * dy - (y as f32 - neck.1) * dx) / length;
            for (channel, unit) in [(20, dx / length), (21, dy / length)] {
                // Away from what the missing shoulder's field drew.
                scene.paf[(channel * H + y) * W + x] = if across.abs() <= 1.0 { unit } else { 0.0 };
            }
        }
    }
    let people = decode(&scene, Layout::Nchw);
    assert_eq!(people.len(), 2);
    assert_eq!(people.iter().filter(|p| p.get(Part::Neck).is_some()).count(), 1);
    let near = people.iter().find(|p| p.get(Part::Neck).is_some()).unwrap();
    assert!(near.get(Part::LeftShoulder).is_none() && near.get(Part::RightWrist).is_some());
}
