//! What a network finds: people made of keypoints.

use crate::{Part, Skeleton, skeleton::Source};

/// A point in the picture: `u` to the right, `v` down, origin at the centre of the top left pixel (see
/// [`preprocess`](crate::preprocess)), and the network's own score, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Keypoint {
    /// Column, px.
    pub u_px: f32,
    /// Row, px.
    pub v_px: f32,
    /// The network's score; not a probability until it has been calibrated.
    pub score: f32,
}

impl Keypoint {
    /// Distance to another keypoint, px.
    pub fn distance_px(&self, other: &Self) -> f32 {
        (self.u_px - other.u_px).hypot(self.v_px - other.v_px)
    }
}

/// An axis-aligned rectangle in the picture, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest column.
    pub left_px: f32,
    /// Smallest row.
    pub top_px: f32,
    /// Largest column.
    pub right_px: f32,
    /// Largest row.
    pub bottom_px: f32,
}

impl Bounds {
    /// The larger side, px.
    pub fn side_px(&self) -> f32 {
        (self.right_px - self.left_px).max(self.bottom_px - self.top_px)
    }

    /// The middle, px.
    pub fn centre_px(&self) -> (f32, f32) {
        (f32::midpoint(self.left_px, self.right_px), f32::midpoint(self.top_px, self.bottom_px))
    }

    /// Area shared with another rectangle over the area of both together, 0 to 1.
    pub fn overlap(&self, other: &Self) -> f32 {
        let w = self.right_px.min(other.right_px) - self.left_px.max(other.left_px);
        let h = self.bottom_px.min(other.bottom_px) - self.top_px.max(other.top_px);
        if w <= 0.0 || h <= 0.0 {
            return 0.0;
        }
        let area = |b: &Self| (b.right_px - b.left_px) * (b.bottom_px - b.top_px);
        w * h / (area(self) + area(other) - w * h)
    }
}

/// One person: a keypoint, or none, for every part of the skeleton.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Person {
    /// The order of `keypoints`.
    pub skeleton: Skeleton,
    /// One entry per part; `None` where the network saw nothing.
    pub keypoints: Vec<Option<Keypoint>>,
    /// Score of the whole person, 0 to 1.
    pub score: f32,
}

impl Person {
    /// The keypoint of a part, if the skeleton has it and the network saw it.
    pub fn get(&self, part: Part) -> Option<Keypoint> {
        self.skeleton.index_of(part).and_then(|i| self.keypoints.get(i).copied().flatten())
    }

    /// Every keypoint that is there, with its part.
    pub fn iter(&self) -> impl Iterator<Item = (Part, Keypoint)> + '_ {
        self.skeleton.parts().iter().zip(&self.keypoints).filter_map(|(p, k)| k.map(|k| (*p, k)))
    }

    /// The same person in another order; parts that the other order lacks are dropped.
    ///
    /// ```
    /// use pose::{Keypoint, Part, Person, Skeleton};
    /// let mut keypoints = vec![None; 17];
    /// keypoints[5] = Some(Keypoint { u_px: 10.0, v_px: 4.0, score: 0.9 });
    /// keypoints[6] = Some(Keypoint { u_px: 20.0, v_px: 6.0, score: 0.5 });
    /// let coco = Person { skeleton: Skeleton::Coco17, keypoints, score: 0.7 };
    /// let neck = coco.to_skeleton(Skeleton::OpenPose18).get(Part::Neck).unwrap();
    /// assert_eq!((neck.u_px, neck.v_px, neck.score), (15.0, 5.0, 0.5));
    /// ```
    #[must_use]
    pub fn to_skeleton(&self, skeleton: Skeleton) -> Self {
        let at = |i: usize| self.keypoints.get(i).copied().flatten();
        let keypoints = skeleton
            .sources(self.skeleton)
            .into_iter()
            .map(|source| match source {
                Source::Same(i) => at(i),
                Source::Middle(i, j) => at(i).zip(at(j)).map(|(a, b)| Keypoint {
                    u_px: f32::midpoint(a.u_px, b.u_px),
                    v_px: f32::midpoint(a.v_px, b.v_px),
                    score: a.score.min(b.score),
                }),
                Source::Absent => None,
            })
            .collect();
        Self { skeleton, keypoints, score: self.score }
    }

    /// The smallest rectangle around the keypoints that score at least `min_score`; `None` without any.
    pub fn bounds(&self, min_score: f32) -> Option<Bounds> {
        let mut found: Option<Bounds> = None;
        for (_, k) in self.iter().filter(|(_, k)| k.score >= min_score) {
            let b =
                found.get_or_insert(Bounds { left_px: k.u_px, top_px: k.v_px, right_px: k.u_px, bottom_px: k.v_px });
            b.left_px = b.left_px.min(k.u_px);
            b.right_px = b.right_px.max(k.u_px);
            b.top_px = b.top_px.min(k.v_px);
            b.bottom_px = b.bottom_px.max(k.v_px);
        }
        found
    }
}
