//! Object keypoint similarity, and matching of detections to labels, as pycocotools does.
//!
//! ```text
//! OKS = mean over labelled i of exp(-d_i^2 / (2 s^2 k_i^2)),    k_i = 2 sigma_i,    s^2 = area + 2^-52
//! ```
//!
//! A label without a labelled keypoint is ignored, as are crowds and labels of another size than the range asks; what
//! matches an ignored label is not counted. For such labels the similarity is taken to the label's box, doubled to each
//! side. Detections are matched best score first, each to the most similar label that is free, and at equal similarity to
//! the later one.

use super::accumulate::{self, OksSummary};
use crate::{Error, Result};

/// Standard deviations of human labels, as fractions of the square root of the area, of COCO's 17 keypoints.
pub const COCO_17_SIGMAS: [f64; 17] = [
    0.026, 0.025, 0.025, 0.035, 0.035, 0.079, 0.079, 0.072, 0.072, 0.062, 0.062, 0.107, 0.107, 0.087, 0.087, 0.089,
    0.089,
];

/// A labelled person of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledPose {
    /// Which picture.
    pub image_id: u64,
    /// For each keypoint u, v and visibility: 0 not labelled, 1 covered, 2 visible.
    pub keypoints: Vec<[f64; 3]>,
    /// Area of the person, px^2.
    pub area_px2: f64,
    /// Left, top, width and height of the box, px.
    pub box_px: [f64; 4],
    /// A group that is not labelled one by one.
    pub is_crowd: bool,
}

/// A detected person of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedPose {
    /// Which picture.
    pub image_id: u64,
    /// For each keypoint u and v, px.
    pub keypoints: Vec<[f64; 2]>,
    /// Score by which detections are ranked.
    pub score: f64,
}

/// What counts: which keypoints, which of their states, which people of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct OksParams {
    /// Standard deviation of each keypoint, as a fraction of the square root of the area.
    pub sigmas: Vec<f64>,
    /// Detections per picture that count, best first.
    pub max_detections: usize,
    /// Which keypoints count.
    pub subset: Subset,
}

/// A choice of keypoints; everything else is taken as not labelled.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Subset {
    /// Indices that count; `None` for all.
    pub keypoints: Option<Vec<usize>>,
    /// The visibility that counts, 1 or 2; `None` for both.
    pub visibility: Option<u8>,
}

impl Default for OksParams {
    fn default() -> Self {
        Self { sigmas: COCO_17_SIGMAS.to_vec(), max_detections: 20, subset: Subset::default() }
    }
}

/// A label with everything but the subset taken away.
pub(super) struct Label<'a> {
    pub(super) pose: &'a LabelledPose,
    counted: Vec<bool>,
    pub(super) ignored: bool,
}

impl OksParams {
    /// Average precision and recall of detections.
    ///
    /// ```
    /// use pose::{DetectedPose, LabelledPose, OksParams};
    /// let at = |u: f64| (0..17).map(|i| [u + f64::from(i), 10.0]).collect::<Vec<_>>();
    /// let label = LabelledPose {
    ///     image_id: 1,
    ///     keypoints: at(5.0).into_iter().map(|[u, v]| [u, v, 2.0]).collect(),
    ///     area_px2: 5000.0,
    ///     box_px: [0.0, 0.0, 50.0, 100.0],
    ///     is_crowd: false,
    /// };
    /// let exact = DetectedPose { image_id: 1, keypoints: at(5.0), score: 0.9 };
    /// let far = DetectedPose { image_id: 1, keypoints: at(500.0), score: 0.95 };
    /// let all = OksParams::default().evaluate(&[label.clone()], &[exact.clone()]).unwrap();
    /// assert!((all.ap.unwrap() - 1.0).abs() < 1e-12);
    /// // A better-scored false alarm halves the precision everywhere.
    /// let half = OksParams::default().evaluate(&[label], &[exact, far]).unwrap();
    /// assert!((half.ap.unwrap() - 0.5).abs() < 1e-12);
    /// ```
    ///
    /// # Errors
    /// [`Error::Length`] when a pose has another number of keypoints than there are sigmas, [`Error::Parameter`] when a
    /// number is not finite, a sigma is not positive, or the subset names what no label has.
    pub fn evaluate(&self, labels: &[LabelledPose], detections: &[DetectedPose]) -> Result<OksSummary> {
        self.check(labels, detections)?;
        Ok(accumulate::summarise(self, labels, detections))
    }

    /// Similarity of one detection to one label.
    ///
    /// # Errors
    /// As [`OksParams::evaluate`].
    pub fn similarity(&self, label: &LabelledPose, detection: &DetectedPose) -> Result<f64> {
        self.check(std::slice::from_ref(label), std::slice::from_ref(detection))?;
        Ok(self.oks(&self.label(label), detection))
    }

    fn check(&self, labels: &[LabelledPose], detections: &[DetectedPose]) -> Result<()> {
        let n = self.sigmas.len();
        let bad = |field, expected, got: String| Err(Error::Parameter { field, expected, got });
        if self.sigmas.is_empty() || !self.sigmas.iter().all(|s| *s > 0.0 && s.is_finite()) {
            return bad("sigmas", "above 0", format!("{:?}", self.sigmas));
        }
        if let Some(index) = self.subset.keypoints.iter().flatten().find(|i| **i >= n) {
            return bad("subset.keypoints", "indices of sigmas", index.to_string());
        }
        if let Some(other) = self.subset.visibility.filter(|v| !(1..=2).contains(v)) {
            return bad("subset.visibility", "1 or 2", other.to_string());
        }
        for label in labels {
            if label.keypoints.len() != n {
                return Err(Error::Length { what: "label keypoints", expected: n, got: label.keypoints.len() });
            }
            let numbers = label.keypoints.iter().flatten().chain(&label.box_px).chain([&label.area_px2]);
            if let Some(x) = numbers.into_iter().find(|x| !x.is_finite()) {
                return bad("label", "finite numbers", x.to_string());
            }
        }
        for detection in detections {
            if detection.keypoints.len() != n {
                return Err(Error::Length { what: "detection keypoints", expected: n, got: detection.keypoints.len() });
            }
            if let Some(x) = detection.keypoints.iter().flatten().chain([&detection.score]).find(|x| !x.is_finite()) {
                return bad("detection", "finite numbers", x.to_string());
            }
        }
        Ok(())
    }

    pub(super) fn label<'a>(&self, pose: &'a LabelledPose) -> Label<'a> {
        let subset = &self.subset;
        let counted: Vec<bool> = pose
            .keypoints
            .iter()
            .enumerate()
            .map(|(i, k)| {
                k[2] > 0.0
                    && subset.keypoints.as_ref().is_none_or(|chosen| chosen.contains(&i))
                    && subset.visibility.is_none_or(|v| (k[2] - f64::from(v)).abs() < 0.5)
            })
            .collect();
        let ignored = pose.is_crowd || !counted.contains(&true);
        Label { pose, counted, ignored }
    }

    pub(super) fn oks(&self, label: &Label<'_>, detection: &DetectedPose) -> f64 {
        let pose = label.pose;
        let [left, top, width, height] = pose.box_px;
        let labelled = label.counted.contains(&true);
        let (mut sum, mut count) = (0.0, 0);
        for (i, (k, [u, v])) in pose.keypoints.iter().zip(&detection.keypoints).enumerate() {
            let (du, dv) = if labelled {
                if !label.counted[i] {
                    continue;
                }
                (u - k[0], v - k[1])
            } else {
                let beyond =
                    |x: f64, from: f64, length: f64| (from - length - x).max(0.0) + (x - from - 2.0 * length).max(0.0);
                (beyond(*u, left, width), beyond(*v, top, height))
            };
            let variance = (2.0 * self.sigmas[i]).powi(2);
            sum += (-(du * du + dv * dv) / variance / (pose.area_px2 + f64::EPSILON) / 2.0).exp();
            count += 1;
        }
        sum / f64::from(count)
    }
}
