use proptest::prelude::*;

use super::*;
use crate::{Part, card::Model};

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
        let apart = |a: (f32, f32), b: (f32, f32)| (a.0 - b.0).hypot(a.1 - b.1) > 6.0;
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
        let matched = decoder.connect(field, from, to, H);

        let (a, b) = (&decoder.peaks()[from], &decoder.peaks()[to]);
        prop_assert_eq!((a.len(), b.len()), (limbs.len(), limbs.len()));
        let value = |i: usize, j: usize| field.line(a[i], b[j], 0.05).0;
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
