//! Body parts, and the orders in which networks and data sets list them.

use std::fmt;

mod orders;

use orders::{BODY_25, COCO_17, MEDIAPIPE_33, OPENPOSE_18, UPPER_LIMB_8};

/// The worker's left or right, not the picture's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The worker's left.
    Left,
    /// The worker's right.
    Right,
}

impl Side {
    /// The other side.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

macro_rules! parts {
    ($($part:ident $name:literal $mirror:ident,)*) => {
        /// A body part. Left and right are the person's own.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[non_exhaustive]
        pub enum Part { $(#[doc = $name] $part,)* }

        impl Part {
            /// Every part that any skeleton names.
            pub const ALL: &[Part] = &[$(Part::$part,)*];

            /// Name in snake case, as model cards write it.
            pub fn name(self) -> &'static str {
                match self { $(Part::$part => $name,)* }
            }

            /// The part at the same place of the other side; a middle part is its own mirror.
            #[must_use]
            pub fn mirrored(self) -> Part {
                match self { $(Part::$part => Part::$mirror,)* }
            }
        }
    };
}

parts! {
    Nose "nose" Nose,
    Neck "neck" Neck,
    MidHip "mid_hip" MidHip,
    LeftEye "left_eye" RightEye,
    RightEye "right_eye" LeftEye,
    LeftEyeInner "left_eye_inner" RightEyeInner,
    RightEyeInner "right_eye_inner" LeftEyeInner,
    LeftEyeOuter "left_eye_outer" RightEyeOuter,
    RightEyeOuter "right_eye_outer" LeftEyeOuter,
    LeftEar "left_ear" RightEar,
    RightEar "right_ear" LeftEar,
    LeftMouth "left_mouth" RightMouth,
    RightMouth "right_mouth" LeftMouth,
    LeftShoulder "left_shoulder" RightShoulder,
    RightShoulder "right_shoulder" LeftShoulder,
    LeftElbow "left_elbow" RightElbow,
    RightElbow "right_elbow" LeftElbow,
    LeftWrist "left_wrist" RightWrist,
    RightWrist "right_wrist" LeftWrist,
    LeftPinky "left_pinky" RightPinky,
    RightPinky "right_pinky" LeftPinky,
    LeftIndex "left_index" RightIndex,
    RightIndex "right_index" LeftIndex,
    LeftThumb "left_thumb" RightThumb,
    RightThumb "right_thumb" LeftThumb,
    LeftHip "left_hip" RightHip,
    RightHip "right_hip" LeftHip,
    LeftKnee "left_knee" RightKnee,
    RightKnee "right_knee" LeftKnee,
    LeftAnkle "left_ankle" RightAnkle,
    RightAnkle "right_ankle" LeftAnkle,
    LeftHeel "left_heel" RightHeel,
    RightHeel "right_heel" LeftHeel,
    LeftBigToe "left_big_toe" RightBigToe,
    RightBigToe "right_big_toe" LeftBigToe,
    LeftSmallToe "left_small_toe" RightSmallToe,
    RightSmallToe "right_small_toe" LeftSmallToe,
    LeftFootIndex "left_foot_index" RightFootIndex,
    RightFootIndex "right_foot_index" LeftFootIndex,
}

impl Part {
    /// Shoulder of a side.
    pub fn shoulder(side: Side) -> Self {
        match side {
            Side::Left => Self::LeftShoulder,
            Side::Right => Self::RightShoulder,
        }
    }

    /// Elbow of a side.
    pub fn elbow(side: Side) -> Self {
        match side {
            Side::Left => Self::LeftElbow,
            Side::Right => Self::RightElbow,
        }
    }

    /// Wrist of a side.
    pub fn wrist(side: Side) -> Self {
        match side {
            Side::Left => Self::LeftWrist,
            Side::Right => Self::RightWrist,
        }
    }

    /// Shoulder, elbow and wrist of a side.
    pub fn arm(side: Side) -> [Self; 3] {
        [Self::shoulder(side), Self::elbow(side), Self::wrist(side)]
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The order in which a network or a data set lists body parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Skeleton {
    /// COCO's 17 keypoints, also MoveNet's.
    #[serde(rename = "coco-17")]
    Coco17,
    /// OpenPose's COCO model: 17 and the neck.
    #[serde(rename = "openpose-18")]
    OpenPose18,
    /// OpenPose's 25 with feet and the middle of the hips.
    #[serde(rename = "body-25")]
    Body25,
    /// BlazePose's 33.
    #[serde(rename = "mediapipe-33")]
    MediaPipe33,
    /// The first eight of OpenPose: nose, neck and both arms.
    #[serde(rename = "upper-limb-8")]
    UpperLimb8,
}

impl Skeleton {
    /// Every skeleton.
    pub const ALL: &[Self] = &[Self::Coco17, Self::OpenPose18, Self::Body25, Self::MediaPipe33, Self::UpperLimb8];

    /// Name as model cards write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coco17 => "coco-17",
            Self::OpenPose18 => "openpose-18",
            Self::Body25 => "body-25",
            Self::MediaPipe33 => "mediapipe-33",
            Self::UpperLimb8 => "upper-limb-8",
        }
    }

    /// The parts in order.
    ///
    /// ```
    /// use pose::{Part, Skeleton};
    /// assert_eq!(Skeleton::Coco17.parts()[10], Part::RightWrist);
    /// assert_eq!(Skeleton::OpenPose18.index_of(Part::RightWrist), Some(4));
    /// ```
    pub fn parts(self) -> &'static [Part] {
        match self {
            Self::Coco17 => COCO_17,
            Self::OpenPose18 => OPENPOSE_18,
            Self::Body25 => BODY_25,
            Self::MediaPipe33 => MEDIAPIPE_33,
            Self::UpperLimb8 => UPPER_LIMB_8,
        }
    }

    /// Number of keypoints.
    #[expect(clippy::len_without_is_empty, reason = "no skeleton is empty")]
    pub fn len(self) -> usize {
        self.parts().len()
    }

    /// Where a part stands in the order.
    pub fn index_of(self, part: Part) -> Option<usize> {
        self.parts().iter().position(|&p| p == part)
    }

    /// For every keypoint, the index of its mirror. Applying it twice changes nothing.
    pub fn mirror(self) -> Vec<usize> {
        let parts = self.parts();
        parts
            .iter()
            .map(|p| parts.iter().position(|q| *q == p.mirrored()).unwrap_or_else(|| unreachable!("{p} has no mirror")))
            .collect()
    }

    /// For every keypoint of `self`, where it comes from in `from`.
    ///
    /// A neck is the middle of the shoulders and a mid-hip the middle of the hips where `from` lacks them.
    pub fn sources(self, from: Self) -> Vec<Source> {
        self.parts()
            .iter()
            .map(|&part| {
                let between = |a, b| match (from.index_of(a), from.index_of(b)) {
                    (Some(a), Some(b)) => Source::Middle(a, b),
                    _ => Source::Absent,
                };
                match (from.index_of(part), part) {
                    (Some(i), _) => Source::Same(i),
                    (None, Part::Neck) => between(Part::LeftShoulder, Part::RightShoulder),
                    (None, Part::MidHip) => between(Part::LeftHip, Part::RightHip),
                    _ => Source::Absent,
                }
            })
            .collect()
    }

    /// Lines to draw between keypoints of this skeleton, as index pairs.
    pub fn bones(self) -> Vec<(usize, usize)> {
        use Part as P;
        let mut bones = Vec::new();
        let pairs = [
            (P::LeftShoulder, P::LeftElbow),
            (P::LeftElbow, P::LeftWrist),
            (P::RightShoulder, P::RightElbow),
            (P::RightElbow, P::RightWrist),
            (P::LeftShoulder, P::RightShoulder),
            (P::LeftShoulder, P::LeftHip),
            (P::RightShoulder, P::RightHip),
            (P::LeftHip, P::RightHip),
            (P::LeftHip, P::LeftKnee),
            (P::LeftKnee, P::LeftAnkle),
            (P::RightHip, P::RightKnee),
            (P::RightKnee, P::RightAnkle),
            (P::Neck, P::Nose),
        ];
        for (a, b) in pairs {
            if let (Some(a), Some(b)) = (self.index_of(a), self.index_of(b)) {
                bones.push((a, b));
            }
        }
        bones
    }
}

impl fmt::Display for Skeleton {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Where a keypoint of one skeleton comes from in another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The same part, at this index.
    Same(usize),
    /// Half way between two parts; both must be there.
    Middle(usize, usize),
    /// The other skeleton has no such part.
    Absent,
}

#[cfg(test)]
mod tests;
