use super::*;
use proptest::prelude::*;

/// Part names as the four formats publish them, written out a second time and by index.
const PUBLISHED: &[(Skeleton, &[&str])] = &[
    (
        Skeleton::Coco17,
        &[
            "nose",
            "left_eye",
            "right_eye",
            "left_ear",
            "right_ear",
            "left_shoulder",
            "right_shoulder",
            "left_elbow",
            "right_elbow",
            "left_wrist",
            "right_wrist",
            "left_hip",
            "right_hip",
            "left_knee",
            "right_knee",
            "left_ankle",
            "right_ankle",
        ],
    ),
    (
        Skeleton::OpenPose18,
        &[
            "nose",
            "neck",
            "right_shoulder",
            "right_elbow",
            "right_wrist",
            "left_shoulder",
            "left_elbow",
            "left_wrist",
            "right_hip",
            "right_knee",
            "right_ankle",
            "left_hip",
            "left_knee",
            "left_ankle",
            "right_eye",
            "left_eye",
            "right_ear",
            "left_ear",
        ],
    ),
    (
        Skeleton::Body25,
        &[
            "nose",
            "neck",
            "right_shoulder",
            "right_elbow",
            "right_wrist",
            "left_shoulder",
            "left_elbow",
            "left_wrist",
            "mid_hip",
            "right_hip",
            "right_knee",
            "right_ankle",
            "left_hip",
            "left_knee",
            "left_ankle",
            "right_eye",
            "left_eye",
            "right_ear",
            "left_ear",
            "left_big_toe",
            "left_small_toe",
            "left_heel",
            "right_big_toe",
            "right_small_toe",
            "right_heel",
        ],
    ),
];

#[test]
fn orders_are_the_published_ones() {
    for (skeleton, names) in PUBLISHED {
        let ours: Vec<_> = skeleton.parts().iter().map(|p| p.name()).collect();
        assert_eq!(&ours[..], *names, "{skeleton}");
    }
    let lengths: Vec<_> = Skeleton::ALL.iter().map(|s| s.len()).collect();
    assert_eq!(lengths, [17, 18, 25, 33, 8]);
}

#[test]
fn the_right_arm_stands_where_every_format_says() {
    let at = |s: Skeleton| Part::arm(Side::Right).map(|p| s.index_of(p));
    assert_eq!(at(Skeleton::Coco17), [Some(6), Some(8), Some(10)]);
    assert_eq!(at(Skeleton::OpenPose18), [Some(2), Some(3), Some(4)]);
    assert_eq!(at(Skeleton::Body25), [Some(2), Some(3), Some(4)]);
    assert_eq!(at(Skeleton::MediaPipe33), [Some(12), Some(14), Some(16)]);
    let left = |s: Skeleton| Part::arm(Side::Left).map(|p| s.index_of(p));
    assert_eq!(left(Skeleton::Coco17), [Some(5), Some(7), Some(9)]);
    assert_eq!(left(Skeleton::MediaPipe33), [Some(11), Some(13), Some(15)]);
}

#[test]
fn no_skeleton_names_a_part_twice_and_mirrors_are_involutions() {
    for &skeleton in Skeleton::ALL {
        let mut parts = skeleton.parts().to_vec();
        parts.sort_unstable();
        parts.dedup();
        assert_eq!(parts.len(), skeleton.len(), "{skeleton}");
        let mirror = skeleton.mirror();
        for (i, &j) in mirror.iter().enumerate() {
            assert_eq!(mirror[j], i, "{skeleton}");
        }
    }
}

#[test]
fn part_names_are_what_serde_reads_and_writes() {
    for part in Part::ALL {
        assert_eq!(serde_json::to_string(part).unwrap_or_default(), format!("\"{}\"", part.name()));
    }
    for skeleton in Skeleton::ALL {
        assert_eq!(serde_json::to_string(skeleton).unwrap_or_default(), format!("\"{}\"", skeleton.name()));
    }
}

#[test]
fn the_neck_of_coco_is_the_middle_of_the_shoulders() {
    let sources = Skeleton::OpenPose18.sources(Skeleton::Coco17);
    assert_eq!(sources[1], Source::Middle(5, 6));
    assert_eq!(Skeleton::Body25.sources(Skeleton::Coco17)[8], Source::Middle(11, 12));
    assert_eq!(Skeleton::Coco17.sources(Skeleton::UpperLimb8)[11], Source::Absent);
}

proptest! {
    /// Going to another order and back is the identity on every part that both have.
    #[test]
    fn maps_between_skeletons_are_partial_permutations(a in 0..5_usize, b in 0..5_usize) {
        let (a, b) = (Skeleton::ALL[a], Skeleton::ALL[b]);
        let there = b.sources(a);
        let back = a.sources(b);
        let mut used = vec![false; a.len()];
        for (j, source) in there.iter().enumerate() {
            if let Source::Same(i) = *source {
                prop_assert!(!used[i], "two parts of {b} come from index {i} of {a}");
                used[i] = true;
                prop_assert_eq!(a.parts()[i], b.parts()[j]);
                prop_assert_eq!(back[i], Source::Same(j));
            }
        }
        let shared = a.parts().iter().filter(|p| b.parts().contains(p)).count();
        prop_assert_eq!(used.iter().filter(|u| **u).count(), shared);
    }
}
