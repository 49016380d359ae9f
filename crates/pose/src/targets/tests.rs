use proptest::prelude::*;

use super::{shape::Runs, *};
use crate::{Limb, Part, Skeleton, card::Model};

fn plan(width: usize, height: usize) -> TargetPlan {
    let limbs = Model::builtin_cards().into_iter().find_map(|c| c.openpose).unwrap().limbs;
    TargetParams::openpose(Skeleton::OpenPose18, limbs, width, height).validate().unwrap()
}

/// The definitions again, cell by cell and in 64-bit floats, with nothing cut off. And by value of the fields: whether the cell lies within a
/// ten-thousandth of a pixel of a limb's edge, where 32 and 64 bits may disagree about a yes or no.
fn slow(plan: &TargetPlan, labels: &Labels<'_>, sample: usize) -> (Maps, Vec<bool>) {
    let mut on_edge = Vec::new();
    let p = &plan.params;
    let (rows, columns) = plan.map_size();
    let joints = p.skeleton.len();
    let n = joints * labels.people;
    let place = |person: usize, j: usize| {
        let i = (sample * n + person * joints + j) * 2;
        (f64::from(labels.joints_px[i]), f64::from(labels.joints_px[i + 1]))
    };
    let state = |person: usize, j: usize| labels.states[sample * n + person * joints + j];
    let in_box = |person: usize, x: f64, y: f64| {
        let b: Vec<f64> =
            labels.boxes_px[(sample * labels.people + person) * 4..][..4].iter().map(|v| f64::from(*v)).collect();
        x >= b[0] && x <= b[2] && y >= b[1] && y <= b[3]
    };
    let gauss = |person: usize, j: usize, x: f64, y: f64| {
        let (px, py) = place(person, j);
        (-((x - px).powi(2) + (y - py).powi(2)) / (2.0 * f64::from(p.sigma_px).powi(2))).exp()
    };
    let mut maps = Maps::default();
    let centres: Vec<(f64, f64)> = (0..rows * columns)
        .map(|i| (((i % columns) as f64 + 0.5) * 8.0 - 0.5, ((i / columns) as f64 + 0.5) * 8.0 - 0.5))
        .collect();
    let people = 0..labels.people;
    for j in 0..joints {
        for &(x, y) in &centres {
            let value = people.clone().filter(|q| state(*q, j) == 3).map(|q| gauss(q, j, x, y)).fold(0.0, f64::max);
            let out = people.clone().any(|q| match state(q, j) {
                1 => gauss(q, j, x, y) > (-4.5_f64).exp(),
                0 => in_box(q, x, y),
                _ => false,
            });
            maps.pcm.push(value as f32);
            maps.pcm_mask.push(!out);
        }
    }
    for (i, &(x, y)) in centres.iter().enumerate() {
        let most = (0..joints).map(|j| maps.pcm[j * centres.len() + i]).fold(0.0, f32::max);
        let out = people.clone().any(|q| {
            (0..joints).any(|j| state(q, j) == 1 && gauss(q, j, x, y) > (-4.5_f64).exp())
                || ((0..joints).any(|j| state(q, j) == 0) && in_box(q, x, y) && 1.0 - most > 0.5)
        });
        maps.pcm.push(1.0 - most);
        maps.pcm_mask.push(!out);
    }
    for &[a, b] in &plan.ends {
        for axis in 0..2 {
            for &(x, y) in &centres {
                let (mut sum, mut count, mut out, mut edge) = (0.0, 0, false, false);
                for q in people.clone() {
                    let ((ax, ay), (bx, by)) = (place(q, a), place(q, b));
                    let length = (bx - ax).hypot(by - ay);
                    let unit = ((bx - ax) / length.max(1e-3), (by - ay) / length.max(1e-3));
                    let forward = (x - ax) * unit.0 + (y - ay) * unit.1;
                    let sideways = (x - ax) * unit.1 - (y - ay) * unit.0;
                    let on = forward >= 0.0 && forward <= length && sideways.abs() <= f64::from(p.half_width_px);
                    let half = f64::from(p.half_width_px);
                    edge |= [forward, forward - length, sideways.abs() - half].iter().any(|gap| gap.abs() < 1e-4);
                    match (state(q, a), state(q, b)) {
                        (3, 3) if on => {
                            sum += if axis == 0 { unit.0 } else { unit.1 };
                            count += 1;
                        }
                        (1, 1 | 3) | (3, 1) => out |= on,
                        (0, 0 | 1 | 3) | (1 | 3, 0) => out |= in_box(q, x, y),
                        _ => {}
                    }
                }
                maps.paf.push((sum / f64::from(count.max(1))) as f32);
                maps.paf_mask.push(!out);
                on_edge.push(edge);
            }
        }
    }
    (maps, on_edge)
}

/// Values agree to 1e-6, but where `passed` over. Places lie on a grid of 1/16 px, so that few cells are on an edge.
fn same<T: Copy + Into<f64>>(a: &[T], b: &[T], passed: &[bool], what: &str) -> Result<(), TestCaseError> {
    prop_assert_eq!(a.len(), b.len(), "{}", what);
    let compared = a.iter().zip(b).enumerate().filter(|(i, _)| !passed.get(*i).is_some_and(|p| *p));
    let worst = compared.map(|(_, (a, b))| ((*a).into() - (*b).into()).abs()).fold(0.0, f64::max);
    prop_assert!(worst <= 1e-6, "{what}: {worst}");
    Ok(())
}

fn labels_strategy(batch: usize, people: usize, scale: i32) -> impl Strategy<Value = (Vec<f32>, Vec<u8>, Vec<f32>)> {
    let n = batch * people;
    (
        proptest::collection::vec((-300..2100_i32).prop_map(move |v| (v * scale) as f32 / 16.0 + 0.03), n * 36),
        proptest::collection::vec(prop_oneof![1 => Just(0_u8), 1 => Just(1), 1 => Just(2), 3 => Just(3)], n * 18),
        proptest::collection::vec((0..1000_i32, 0..1000_i32, 100..1000_i32, 100..1000_i32), n),
    )
        .prop_map(move |(joints, states, boxes)| {
            let boxes = boxes
                .iter()
                .flat_map(|(x, y, w, h)| [*x, *y, x + w, y + h].map(|v| (v * scale) as f32 / 16.0 + 0.01))
                .collect();
            (joints, states, boxes)
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Judge: the definitions without any short cut. Maps of 8, 16 and 46 columns, which registers of cells do not, just and
    /// several times fit into.
    #[test]
    fn encoding_equals_the_slow_reference(
        (width, half_width_px, (joints_px, states, boxes_px)) in
            prop_oneof![Just((64, 8.0, 1)), Just((128, 20.0, 1)), Just((368, 8.0, 3))]
                .prop_flat_map(|(width, half, scale)| (Just(width), Just(half), labels_strategy(3, 2, scale))),
    ) {
        let plan = TargetParams { half_width_px, ..plan(width, 96).params }.validate().unwrap();
        let labels = Labels { batch: 3, people: 2, joints_px: &joints_px, states: &states, boxes_px: &boxes_px };
        let maps = plan.encode(&labels).unwrap();
        for sample in 0..3 {
            let (expected, on_edge) = slow(&plan, &labels, sample);
            prop_assert!(on_edge.iter().filter(|e| **e).count() * 100 < on_edge.len(), "more than one cell in a hundred on an edge");
            let (pcm, paf) = plan.lengths();
            let (pcm, paf) = (sample * pcm..(sample + 1) * pcm, sample * paf..(sample + 1) * paf);
            same(&maps.pcm[pcm.clone()], &expected.pcm, &[], "pcm")?;
            same(&maps.pcm_mask[pcm], &expected.pcm_mask, &[], "pcm mask")?;
            same(&maps.paf[paf.clone()], &expected.paf, &on_edge, "paf")?;
            same(&maps.paf_mask[paf], &expected.paf_mask, &on_edge, "paf mask")?;
        }
    }

    /// Judge: equation (3) cell by cell.
    #[test]
    fn fusion_takes_the_larger_response(
        (joints_px, states, boxes_px) in labels_strategy(2, 1, 1), seed in any::<u64>(),
    ) {
        let plan = plan(64, 64);
        let labels = Labels { batch: 2, people: 1, joints_px: &joints_px, states: &states, boxes_px: &boxes_px };
        let base = plan.encode(&labels).unwrap();
        let mut state = seed | 1;
        let mut noise = |n: usize| -> Vec<f32> {
            (0..n).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f32 / (1_u64 << 24) as f32 * 1.6 - 0.4
            }).collect()
        };
        let (pcm_t, paf_t) = (noise(base.pcm.len()), noise(base.paf.len()));
        let mut fused = base.clone();
        plan.fuse(&mut fused, &pcm_t, &paf_t, 0.1).unwrap();
        let mut together = Maps::default();
        plan.encode_fused_into(&labels, &pcm_t, &paf_t, 0.1, &mut together).unwrap();
        prop_assert_eq!(&together, &fused);
        for b in 0..2 {
            for cell in 0..64 {
                let mut most = 0.0_f32;
                let mut answered = false;
                for j in 0..18 {
                    let i = (b * 19 + j) * 64 + cell;
                    let expected = base.pcm[i].max(pcm_t[i].clamp(0.0, 1.0));
                    prop_assert!((fused.pcm[i] - expected).abs() <= 1e-6);
                    let counts = pcm_t[i] >= 0.1 || base.pcm_mask[i];
                    prop_assert_eq!(fused.pcm_mask[i], counts);
                    most = most.max(expected);
                    answered |= pcm_t[i] >= 0.1;
                }
                let i = (b * 19 + 18) * 64 + cell;
                prop_assert!((fused.pcm[i] - (1.0 - most)).abs() <= 1e-6);
                prop_assert_eq!(fused.pcm_mask[i], answered || base.pcm_mask[i]);
                for limb in 0..19 {
                    let (x, y) = ((b * 38 + 2 * limb) * 64 + cell, (b * 38 + 2 * limb + 1) * 64 + cell);
                    let own = base.paf[x].hypot(base.paf[y]);
                    let theirs = paf_t[x].hypot(paf_t[y]);
                    prop_assume!((own - theirs).abs() > 1e-6 && (theirs - 0.1).abs() > 1e-6);
                    let from = if own > theirs { &base.paf } else { &paf_t };
                    prop_assert!((fused.paf[x] - from[x]).abs() <= 1e-6 && (fused.paf[y] - from[y]).abs() <= 1e-6);
                    prop_assert_eq!(fused.paf_mask[x], theirs >= 0.1 || base.paf_mask[x]);
                    prop_assert_eq!(fused.paf_mask[y], theirs >= 0.1 || base.paf_mask[y]);
                }
            }
        }
    }
}

/// Law: a teacher that says nothing changes nothing; fusing twice changes nothing more.
#[test]
fn fusion_is_idempotent_and_a_silent_teacher_changes_nothing() {
    let plan = plan(64, 64);
    let joints_px: Vec<f32> = (0..36).map(|i| 5.0 + (i * 13 % 50) as f32).collect();
    let labels =
        Labels { batch: 1, people: 1, joints_px: &joints_px, states: &[3; 18], boxes_px: &[0.0, 0.0, 63.0, 63.0] };
    let base = plan.encode(&labels).unwrap();
    let mut fused = base.clone();
    plan.fuse(&mut fused, &vec![0.0; base.pcm.len()], &vec![0.0; base.paf.len()], 0.1).unwrap();
    assert_eq!(fused, base);
    let (pcm_t, paf_t) = (vec![0.4; base.pcm.len()], vec![0.3; base.paf.len()]);
    plan.fuse(&mut fused, &pcm_t, &paf_t, 0.1).unwrap();
    let once = fused.clone();
    plan.fuse(&mut fused, &pcm_t, &paf_t, 0.1).unwrap();
    assert_eq!(fused, once);
}

#[test]
fn wrong_lengths_states_and_nan_are_refused_by_name() {
    let plan = plan(64, 64);
    let (joints, states, boxes) = (vec![1.0; 36], vec![3_u8; 18], vec![0.0; 4]);
    let labels = Labels { batch: 1, people: 1, joints_px: &joints, states: &states, boxes_px: &boxes };
    assert!(matches!(plan.encode(&Labels { batch: 2, ..labels }), Err(Error::Length { what: "joints_px", .. })));
    assert!(plan.encode(&Labels { states: &[4; 18], ..labels }).is_err());
    assert!(plan.encode_fused_into(&labels, &[], &[], 0.1, &mut Maps::default()).is_err());
    assert!(plan.encode_fused_into(&labels, &[0.0; 1216], &[0.0; 2432], f32::NAN, &mut Maps::default()).is_err());
    assert!(plan.encode_fused_into(&labels, &[0.0; 1216], &[0.0; 2432], 0.1, &mut Maps::default()).is_ok());
    let mut nan = joints.clone();
    nan[7] = f32::NAN;
    assert!(plan.encode(&Labels { joints_px: &nan, ..labels }).is_err());
    assert!(plan.encode(&Labels { joints_px: &nan, states: &[2; 18], ..labels }).is_ok());
    let limb = Limb { from: Part::Nose, to: Part::LeftHeel, paf: [0, 1] };
    assert!(TargetParams::openpose(Skeleton::OpenPose18, vec![limb], 64, 64).validate().is_err());
}

#[test]
fn parameters_of_no_target_are_refused_by_name() {
    let limb = |from, to, first| Limb { from, to, paf: [first, first + 1] };
    let (upper, lower) = (limb(Part::RightShoulder, Part::RightElbow, 0), limb(Part::RightElbow, Part::RightWrist, 2));
    let good = TargetParams::openpose(Skeleton::OpenPose18, vec![upper, lower], 64, 64);
    assert!(good.clone().validate().is_ok());
    let with_limbs = |limbs| TargetParams { limbs, ..good.clone() };
    let cases = [
        ("width", TargetParams { width: 60, ..good.clone() }),
        ("width", TargetParams { width: 0, ..good.clone() }),
        ("width", TargetParams { stride: 0, ..good.clone() }),
        ("height", TargetParams { height: 60, ..good.clone() }),
        ("sigma_px", TargetParams { sigma_px: 0.0, ..good.clone() }),
        ("sigma_px", TargetParams { sigma_px: f32::NAN, ..good.clone() }),
        ("half_width_px", TargetParams { half_width_px: -1.0, ..good.clone() }),
        ("limbs", with_limbs(vec![])),
        ("limbs.paf", with_limbs(vec![upper, Limb { paf: [0, 1], ..lower }])),
        ("limbs.paf", with_limbs(vec![upper, Limb { paf: [4, 5], ..lower }])),
        ("limbs.paf", with_limbs(vec![upper, Limb { paf: [3, 2], ..lower }])),
    ];
    for (expected, params) in cases {
        let refused = params.clone().validate();
        assert!(matches!(refused, Err(Error::Parameter { field, .. }) if field == expected), "{params:?}: {refused:?}");
    }
}

/// Judge: counting, over every run of columns of every row that registers fit into.
#[test]
fn every_column_is_meant_once_and_no_run_leaves_the_row() {
    for cells in 16..50 {
        for (start, end) in (0..cells).flat_map(|start| (start..=cells).map(move |end| (start, end))) {
            let mut met = vec![0; cells];
            for run in Runs::<16>::new(start..end, Axis::new(cells, 8)) {
                assert!(run.first + 16 <= cells, "{start}..{end} of {cells}");
                (0..16).filter(|i| run.has(*i)).for_each(|i| met[run.first + i] += 1);
            }
            let expected: Vec<i32> = (0..cells).map(|c| i32::from((start..end).contains(&c))).collect();
            assert_eq!(met, expected, "{start}..{end} of {cells}");
        }
    }
}

/// Law: a person far beyond the picture does nothing to its maps, and a limb whose length overflows nothing to its field.
#[test]
fn a_person_far_beyond_the_picture_leaves_no_mark() {
    let plan = plan(368, 96);
    let near: Vec<f32> = (0..36).map(|i| 5.0 + (i * 13 % 90) as f32).collect();
    let alone = Labels { batch: 1, people: 1, joints_px: &near, states: &[3; 18], boxes_px: &[0.0, 0.0, 367.0, 95.0] };
    let expected = plan.encode(&alone).unwrap();
    let beyond = |i: usize| 1e9 / (i + 1) as f32;
    let around = |i: usize| if i.is_multiple_of(3) { 1e25 } else { -1e25 };
    let widest = |i: usize| if i.is_multiple_of(3) { f32::MAX } else { f32::MIN };
    for far in [beyond as fn(usize) -> f32, around, widest] {
        let both: Vec<f32> = near.iter().copied().chain((0..36).map(far)).collect();
        let labels = Labels { people: 2, joints_px: &both, states: &[3; 36], boxes_px: &[0.0; 8], ..alone };
        assert_eq!(plan.encode(&labels).unwrap(), expected, "{:?}", &both[36..]);
    }
}
