//! Keypoints in the order of OpenPose's COCO model (18 parts).

/// Number of keypoints in OpenPose-18 order.
pub const KEYPOINT_COUNT: usize = 18;

/// A body part, numbered as in OpenPose's COCO model (Cao et al., 2017).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keypoint {
    /// Tip of the nose.
    Nose,
    /// Middle between the shoulders.
    Neck,
    /// Right shoulder centre.
    RightShoulder,
    /// Right elbow centre.
    RightElbow,
    /// Right wrist centre.
    RightWrist,
    /// Left shoulder centre.
    LeftShoulder,
    /// Left elbow centre.
    LeftElbow,
    /// Left wrist centre.
    LeftWrist,
    /// Right hip centre.
    RightHip,
    /// Right knee centre.
    RightKnee,
    /// Right ankle centre.
    RightAnkle,
    /// Left hip centre.
    LeftHip,
    /// Left knee centre.
    LeftKnee,
    /// Left ankle centre.
    LeftAnkle,
    /// Right eye.
    RightEye,
    /// Left eye.
    LeftEye,
    /// Right ear.
    RightEar,
    /// Left ear.
    LeftEar,
}

impl Keypoint {
    /// All keypoints; `Keypoint::ALL[k.index()] == k`.
    pub const ALL: [Self; KEYPOINT_COUNT] = [
        Self::Nose,
        Self::Neck,
        Self::RightShoulder,
        Self::RightElbow,
        Self::RightWrist,
        Self::LeftShoulder,
        Self::LeftElbow,
        Self::LeftWrist,
        Self::RightHip,
        Self::RightKnee,
        Self::RightAnkle,
        Self::LeftHip,
        Self::LeftKnee,
        Self::LeftAnkle,
        Self::RightEye,
        Self::LeftEye,
        Self::RightEar,
        Self::LeftEar,
    ];

    /// For each of the 17 COCO keypoints, the same part here.
    pub const COCO: [Self; 17] = [
        Self::Nose,
        Self::LeftEye,
        Self::RightEye,
        Self::LeftEar,
        Self::RightEar,
        Self::LeftShoulder,
        Self::RightShoulder,
        Self::LeftElbow,
        Self::RightElbow,
        Self::LeftWrist,
        Self::RightWrist,
        Self::LeftHip,
        Self::RightHip,
        Self::LeftKnee,
        Self::RightKnee,
        Self::LeftAnkle,
        Self::RightAnkle,
    ];

    /// Position in OpenPose-18 order.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Lower-case name with underscores, as COCO writes it (`right_wrist`).
    pub fn name(self) -> &'static str {
        match self {
            Self::Nose => "nose",
            Self::Neck => "neck",
            Self::RightShoulder => "right_shoulder",
            Self::RightElbow => "right_elbow",
            Self::RightWrist => "right_wrist",
            Self::LeftShoulder => "left_shoulder",
            Self::LeftElbow => "left_elbow",
            Self::LeftWrist => "left_wrist",
            Self::RightHip => "right_hip",
            Self::RightKnee => "right_knee",
            Self::RightAnkle => "right_ankle",
            Self::LeftHip => "left_hip",
            Self::LeftKnee => "left_knee",
            Self::LeftAnkle => "left_ankle",
            Self::RightEye => "right_eye",
            Self::LeftEye => "left_eye",
            Self::RightEar => "right_ear",
            Self::LeftEar => "left_ear",
        }
    }
}
