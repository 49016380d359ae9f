//! How good keypoints are: object keypoint similarity with average precision and recall as COCO defines them, and the
//! percentage of correct keypoints.

mod accumulate;
mod oks;
mod pck;

pub use accumulate::OksSummary;
pub use oks::{COCO_17_SIGMAS, DetectedPose, LabelledPose, OksParams, Subset};
pub use pck::{PckCounts, pck};
