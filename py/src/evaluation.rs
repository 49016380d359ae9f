//! Average precision of keypoints.

use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pose::{DetectedPose, LabelledPose, OksParams, Subset};
use pyo3::prelude::*;

use crate::array::{borrowed, check_len};
use crate::failure::Failure;

/// The ten numbers of COCO.
#[pyfunction]
#[pyo3(signature = (gt_images, gt_keypoints, gt_boxes, gt_crowd, dt_images, dt_keypoints, dt_scores, *, sigmas, keypoints, visibility, max_detections))]
#[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
pub(crate) fn evaluate_keypoints(
    py: Python<'_>,
    gt_images: Vec<u64>,
    gt_keypoints: PyReadonlyArray3<'_, f64>,
    gt_boxes: PyReadonlyArray2<'_, f64>,
    gt_crowd: Vec<bool>,
    dt_images: Vec<u64>,
    dt_keypoints: PyReadonlyArray3<'_, f64>,
    dt_scores: Vec<f64>,
    sigmas: Vec<f64>,
    keypoints: Option<Vec<usize>>,
    visibility: Option<u8>,
    max_detections: usize,
) -> PyResult<[Option<f64>; 10]> {
    check_len("numbers per label keypoint", 3, gt_keypoints.shape()[2])?;
    check_len("numbers per label box and area", 5, gt_boxes.shape()[1])?;
    check_len("numbers per detection keypoint", 2, dt_keypoints.shape()[2])?;
    let joints = sigmas.len();
    for (what, got) in
        [("keypoints of a label", gt_keypoints.shape()[1]), ("keypoints of a detection", dt_keypoints.shape()[1])]
    {
        check_len(what, joints, got)?;
    }
    let labels: Vec<LabelledPose> = borrowed("gt_keypoints", &gt_keypoints)?
        .chunks_exact(3 * joints.max(1))
        .zip(borrowed("gt_boxes", &gt_boxes)?.chunks_exact(5))
        .zip(gt_images.iter().zip(&gt_crowd))
        .map(|((points, place), (&image_id, &is_crowd))| LabelledPose {
            image_id,
            keypoints: points.chunks_exact(3).map(|k| [k[0], k[1], k[2]]).collect(),
            area_px2: place[4],
            box_px: [place[0], place[1], place[2], place[3]],
            is_crowd,
        })
        .collect();
    let detections: Vec<DetectedPose> = borrowed("dt_keypoints", &dt_keypoints)?
        .chunks_exact(2 * joints.max(1))
        .zip(dt_images.iter().zip(&dt_scores))
        .map(|(points, (&image_id, &score))| DetectedPose {
            image_id,
            keypoints: points.chunks_exact(2).map(|k| [k[0], k[1]]).collect(),
            score,
        })
        .collect();
    let params = OksParams { sigmas, max_detections, subset: Subset { keypoints, visibility } };
    let s = py.detach(|| params.evaluate(&labels, &detections)).map_err(Failure::from)?;
    Ok([s.ap, s.ap_50, s.ap_75, s.ap_medium, s.ap_large, s.ar, s.ar_50, s.ar_75, s.ar_medium, s.ar_large])
}

/// COCO's standard deviations.
#[pyfunction]
pub(crate) fn coco_sigmas() -> Vec<f64> {
    pose::COCO_17_SIGMAS.to_vec()
}
