//! Each rule alone, on a person drawn by definition or on peaks put by hand.

use super::*;

const RIGHT_WRIST: usize = 4;
const LEFT_WRIST: usize = 7;

fn view<'a>(data: &'a [f32], spec: &crate::card::MapSpec) -> MapView<'a> {
    MapView { data, layout: Layout::Nchw, channels: spec.channels, first: 0, width: W, height: H }
}

fn decode_with(scene: &Scene, min_score: f32) -> Vec<Person> {
    let spec = spec();
    let mut decoder = OpenPoseDecoder::new(Skeleton::OpenPose18, &spec, min_score);
    decoder.decode(view(&scene.pcm, &spec.pcm), view(&scene.paf, &spec.paf))
}

fn drawn(people: &[Vec<(f32, f32)>]) -> Scene {
    draw(people, &spec(), Skeleton::OpenPose18, Layout::Nchw)
}

fn scale_part(scene: &mut Scene, part: usize, gain: f32) {
    scene.pcm[part * W * H..(part + 1) * W * H].iter_mut().for_each(|cell| *cell *= gain);
}

#[test]
fn a_weak_keypoint_is_left_out_of_its_person_and_none_scores_above_1() {
    let mut scene = drawn(&[body(30.0, 10.0)]);
    scale_part(&mut scene, RIGHT_WRIST, 0.4);
    scale_part(&mut scene, LEFT_WRIST, 3.0);
    let people = decode_with(&scene, 0.5);
    assert_eq!(people.len(), 1);
    assert_eq!(people[0].keypoints.iter().flatten().count(), 17);
    assert_eq!(people[0].get(Part::RightWrist), None);
    assert!((people[0].get(Part::LeftWrist).unwrap().score - 1.0).abs() < 1e-6);
    assert!(decode_with(&scene, 0.2)[0].get(Part::RightWrist).is_some());
}

/// The first limb is matched best first, so the person with the strong neck is assembled first.
#[test]
fn people_are_listed_by_their_evidence() {
    let mut scene = drawn(&[body(12.0, 8.0), body(40.0, 8.0)]);
    for part in 0..18 {
        let is_first_limb = (1..3).contains(&part);
        for (cell, value) in scene.pcm[part * W * H..][..W * H].iter_mut().enumerate() {
            let is_left = cell % W < W / 2;
            *value *= if is_left == is_first_limb { 0.9 } else { 0.6 };
        }
    }
    let people = decode_with(&scene, 0.1);
    assert_eq!(people.len(), 2);
    assert!(people[0].score > people[1].score + 0.1, "{} {}", people[0].score, people[1].score);
    assert!(people[0].get(Part::Neck).unwrap().u_px > people[1].get(Part::Neck).unwrap().u_px);
}

#[test]
fn a_faint_whole_person_comes_before_three_sure_parts_of_another() {
    let mut scene = drawn(&[body(12.0, 8.0), body(40.0, 8.0)]);
    for part in 0..18 {
        for (cell, value) in scene.pcm[part * W * H..][..W * H].iter_mut().enumerate() {
            let is_piece = cell % W > W / 2;
            *value *= if is_piece { f32::from(u8::from((2..5).contains(&part))) } else { 0.6 };
        }
    }
    let people = decode_with(&scene, 0.1);
    assert_eq!(people.len(), 2);
    assert!(people[0].score < people[1].score - 0.3, "{} {}", people[0].score, people[1].score);
    assert_eq!(people.iter().map(|p| p.keypoints.iter().flatten().count()).collect::<Vec<_>>(), [18, 3]);
}

/// A person without arms below the shoulder, and somebody who has the elbow and the wrist that the field joins to it.
fn chosen_beside(other: &[(usize, usize)]) -> Vec<Body> {
    let mut decoder = OpenPoseDecoder::new(Skeleton::OpenPose18, &spec(), 0.1);
    for peaks in &mut decoder.peaks {
        *peaks = (0..2).map(|i| Peak { x: 20.0 + 10.0 * i as f32, y: 20.0, score: 0.9 }).collect();
    }
    let limb = |from, to| decoder.limbs.iter().position(|ends| *ends == [from, to]).unwrap();
    let link = Connection { from: 0, to: 0, score: 0.8, rank: 0.98 };
    let mut supported = vec![Vec::new(); decoder.limbs.len()];
    for ends in [[1, 2], [2, 3], [3, 4]] {
        supported[limb(ends[0], ends[1])].push(link);
    }
    let with = |parts: &[(usize, usize)], limbs: Vec<(usize, Connection)>| {
        let mut body = Body { parts: vec![None; 18], limbs };
        parts.iter().for_each(|(part, candidate)| body.parts[*part] = Some(*candidate));
        body
    };
    let mut bodies = [
        with(&[(0, 0), (1, 0), (2, 0)], vec![(limb(1, 0), link), (limb(1, 2), link)]),
        with(other, vec![(limb(3, 4), link)]),
    ];
    decoder.choose_arms(&mut bodies, &mut supported);
    bodies.to_vec()
}

#[test]
fn a_piece_without_a_neck_gives_its_arm_to_the_person_it_belongs_to() {
    let bodies = chosen_beside(&[(3, 0), (4, 0), (8, 1)]);
    assert_eq!(bodies[0].parts[1..5], [Some(0); 4]);
    assert_eq!(bodies[0].limbs.len(), 4);
    assert_eq!((bodies[1].parts[3], bodies[1].parts[4], bodies[1].parts[8]), (None, None, Some(1)));
    assert!(bodies[1].limbs.is_empty());
}

#[test]
fn a_person_with_a_neck_keeps_the_arm() {
    let bodies = chosen_beside(&[(1, 1), (3, 0), (4, 0)]);
    assert_eq!(bodies[0].parts[1..5], [Some(0), Some(0), None, None]);
    assert_eq!(bodies[1].parts[3..5], [Some(0); 2]);
}

#[test]
fn maps_in_the_middle_of_one_tensor_are_the_same_maps() {
    let spec = spec();
    let expected = decode_with(&drawn(&[body(20.0, 10.0)]), 0.1);
    let (before, between) = (2, 1);
    let fields = before + spec.pcm.channels + between;
    let channels = fields + spec.paf.channels;
    for layout in [Layout::Nchw, Layout::Nhwc] {
        let scene = drawn(&[body(20.0, 10.0)]);
        let mut data = vec![0.7; channels * W * H];
        for (first, maps) in [(before, &scene.pcm), (fields, &scene.paf)] {
            for (i, value) in maps.iter().enumerate() {
                let (channel, cell) = (first + i / (W * H), i % (W * H));
                match layout {
                    Layout::Nchw => data[channel * W * H + cell] = *value,
                    Layout::Nhwc => data[cell * channels + channel] = *value,
                }
            }
        }
        let block = |first| MapView { data: &data, layout, channels, first, width: W, height: H };
        let mut decoder = OpenPoseDecoder::new(Skeleton::OpenPose18, &spec, 0.1);
        assert_eq!(decoder.decode(block(before), block(fields)), expected, "{layout:?}");
    }
}

/// Joins one neck and one shoulder through a constant field; the score of the limb.
fn joined_through(field: [f32; 2], neck: (f32, f32), shoulder: (f32, f32)) -> Option<f32> {
    let data: Vec<f32> = field.iter().flat_map(|v| vec![*v; W * H]).collect();
    let maps = MapView { data: &data, layout: Layout::Nchw, channels: 2, first: 0, width: W, height: H };
    let mut decoder = OpenPoseDecoder::new(Skeleton::OpenPose18, &spec(), 0.1);
    decoder.peaks[1] = vec![Peak { x: neck.0, y: neck.1, score: 0.9 }];
    decoder.peaks[2] = vec![Peak { x: shoulder.0, y: shoulder.1, score: 0.9 }];
    let matched = decoder.match_up(&decoder.supported(Field { maps, channels: [0, 1] }, 1, 2, H), [1, 2]);
    matched.first().map(|c| c.score)
}

#[test]
fn two_parts_in_one_place_are_a_limb_where_the_field_is_strong() {
    let place = (20.0, 20.0);
    let score = joined_through([0.3, -0.4], place, place).unwrap();
    assert!((score - 0.5).abs() < 1e-6, "{score}");
    assert_eq!(joined_through([0.03, 0.0], place, place), None);
}

#[test]
fn a_limb_longer_than_half_the_map_is_penalised_and_one_against_the_field_is_none() {
    // 40 of 46 rows: 0.9 + 23 / 40 - 1.
    let score = joined_through([0.9, 0.0], (5.0, 20.0), (45.0, 20.0)).unwrap();
    assert!((score - (0.9 + 23.0 / 40.0 - 1.0)).abs() < 1e-5, "{score}");
    let score = joined_through([0.9, 0.0], (5.0, 20.0), (15.0, 20.0)).unwrap();
    assert!((score - 0.9).abs() < 1e-5, "{score}");
    assert_eq!(joined_through([0.9, 0.0], (15.0, 20.0), (5.0, 20.0)), None);
    // Supported, but the penalty leaves nothing.
    assert_eq!(joined_through([0.2, 0.0], (5.0, 20.0), (45.0, 20.0)), None);
}
