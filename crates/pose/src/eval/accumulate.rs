//! From matches to precision over recall, and to the ten numbers that COCO reports.

use std::collections::BTreeMap;

use super::oks::{DetectedPose, Label, LabelledPose, OksParams};

/// COCO's numbers; `None` where no label is of the size.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct OksSummary {
    /// Average precision over similarities 0.50, 0.55 to 0.95.
    pub ap: Option<f64>,
    /// At similarity 0.50.
    pub ap_50: Option<f64>,
    /// At similarity 0.75.
    pub ap_75: Option<f64>,
    /// Of people of 32^2 to 96^2 px^2.
    pub ap_medium: Option<f64>,
    /// Of larger people.
    pub ap_large: Option<f64>,
    /// Average recall over the same similarities.
    pub ar: Option<f64>,
    /// At similarity 0.50.
    pub ar_50: Option<f64>,
    /// At similarity 0.75.
    pub ar_75: Option<f64>,
    /// Of people of 32^2 to 96^2 px^2.
    pub ar_medium: Option<f64>,
    /// Of larger people.
    pub ar_large: Option<f64>,
}

impl OksSummary {
    /// The ten numbers in COCO's order, -1 where there is none.
    pub fn to_array(&self) -> [f64; 10] {
        [
            self.ap,
            self.ap_50,
            self.ap_75,
            self.ap_medium,
            self.ap_large,
            self.ar,
            self.ar_50,
            self.ar_75,
            self.ar_medium,
            self.ar_large,
        ]
        .map(|x| x.unwrap_or(-1.0))
    }
}

const THRESHOLDS: usize = 10;
const RECALLS: usize = 101;
const MEDIUM: (f64, f64) = (1024.0, 9216.0);
const LARGE: (f64, f64) = (9216.0, 1e10);
const ALL: (f64, f64) = (0.0, 1e10);

/// `numpy.linspace(0.5, 0.95, 10)`.
fn threshold(i: usize) -> f64 {
    if i + 1 == THRESHOLDS { 0.95 } else { 0.5 + i as f64 * (0.45 / 9.0) }
}

/// `numpy.linspace(0, 1, 101)`.
fn recall_point(i: usize) -> f64 {
    i as f64 * 0.01
}

/// Labels and detections of one picture, with their similarities.
struct Picture<'a> {
    labels: Vec<Label<'a>>,
    /// Best score first, at most the allowed number.
    detections: Vec<&'a DetectedPose>,
    /// `[detection][label]`.
    oks: Vec<Vec<f64>>,
}

/// One detection in one area range: does it match, and is it left out, for each threshold.
struct Ranked {
    score: f64,
    matched: [bool; THRESHOLDS],
    left_out: [bool; THRESHOLDS],
}

/// Precision at every recall point, and the largest recall, for each threshold.
struct Curves {
    precision: Vec<[f64; RECALLS]>,
    recall: [f64; THRESHOLDS],
}

pub(super) fn summarise(params: &OksParams, labels: &[LabelledPose], detections: &[DetectedPose]) -> OksSummary {
    let pictures = pictures(params, labels, detections);
    let [all, medium, large] = [ALL, MEDIUM, LARGE].map(|range| curves(&pictures, range));
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let ap = |c: &Option<Curves>| c.as_ref().map(|c| mean(c.precision.as_flattened()));
    let ar = |c: &Option<Curves>| c.as_ref().map(|c| mean(&c.recall));
    let ap_at = |i: usize| all.as_ref().map(|c| mean(&c.precision[i]));
    let ar_at = |i: usize| all.as_ref().map(|c| c.recall[i]);
    OksSummary {
        ap: ap(&all),
        ap_50: ap_at(0),
        ap_75: ap_at(5),
        ap_medium: ap(&medium),
        ap_large: ap(&large),
        ar: ar(&all),
        ar_50: ar_at(0),
        ar_75: ar_at(5),
        ar_medium: ar(&medium),
        ar_large: ar(&large),
    }
}

fn pictures<'a>(params: &OksParams, labels: &'a [LabelledPose], detections: &'a [DetectedPose]) -> Vec<Picture<'a>> {
    let mut by_id: BTreeMap<u64, (Vec<Label<'a>>, Vec<&'a DetectedPose>)> = BTreeMap::new();
    for label in labels {
        by_id.entry(label.image_id).or_default().0.push(params.label(label));
    }
    for detection in detections {
        by_id.entry(detection.image_id).or_default().1.push(detection);
    }
    by_id
        .into_values()
        .map(|(labels, mut detections)| {
            detections.sort_by(|a, b| b.score.total_cmp(&a.score));
            detections.truncate(params.max_detections);
            let oks = detections.iter().map(|d| labels.iter().map(|l| params.oks(l, d)).collect()).collect();
            Picture { labels, detections, oks }
        })
        .collect()
}

/// Area of a detection: the box around its keypoints.
fn area_of(detection: &DetectedPose) -> f64 {
    let side = |axis: usize| {
        let values = || detection.keypoints.iter().map(|k| k[axis]);
        values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min)
    };
    side(0) * side(1)
}

fn match_picture(picture: &Picture<'_>, range: (f64, f64), ranked: &mut Vec<Ranked>) -> usize {
    let outside = |area: f64| area < range.0 || area > range.1;
    let ignored: Vec<bool> = picture.labels.iter().map(|l| l.ignored || outside(l.pose.area_px2)).collect();
    // Labels that count come first; the order is kept otherwise.
    let mut order: Vec<usize> = (0..ignored.len()).collect();
    order.sort_by_key(|i| ignored[*i]);
    let first = ranked.len();
    ranked.extend(picture.detections.iter().map(|d| Ranked {
        score: d.score,
        matched: [false; THRESHOLDS],
        left_out: [false; THRESHOLDS],
    }));
    for t in 0..THRESHOLDS {
        let mut taken = vec![false; ignored.len()];
        for (d, detection) in picture.detections.iter().enumerate() {
            let mut best = (threshold(t).min(1.0 - 1e-10), None);
            for &l in &order {
                if taken[l] && !picture.labels[l].pose.is_crowd {
                    continue;
                }
                if best.1.is_some_and(|m: usize| !ignored[m]) && ignored[l] {
                    break;
                }
                if picture.oks[d][l] >= best.0 {
                    best = (picture.oks[d][l], Some(l));
                }
            }
            let slot = &mut ranked[first + d];
            match best.1 {
                Some(l) => {
                    taken[l] = true;
                    slot.matched[t] = true;
                    slot.left_out[t] = ignored[l];
                }
                None => slot.left_out[t] = outside(area_of(detection)),
            }
        }
    }
    ignored.iter().filter(|i| !**i).count()
}

fn curves(pictures: &[Picture<'_>], range: (f64, f64)) -> Option<Curves> {
    let mut ranked = Vec::new();
    let positives: usize = pictures.iter().map(|p| match_picture(p, range, &mut ranked)).sum();
    if positives == 0 {
        return None;
    }
    ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut curves = Curves { precision: vec![[0.0; RECALLS]; THRESHOLDS], recall: [0.0; THRESHOLDS] };
    for t in 0..THRESHOLDS {
        let (mut hits, mut misses) = (0.0, 0.0);
        let (mut recall, mut precision) = (Vec::new(), Vec::new());
        for r in &ranked {
            if !r.left_out[t] {
                hits += f64::from(u8::from(r.matched[t]));
                misses += f64::from(u8::from(!r.matched[t]));
            }
            recall.push(hits / positives as f64);
            precision.push(hits / (misses + hits + f64::EPSILON));
        }
        // Precision at a recall is the best at that recall or any larger one.
        for i in (1..precision.len()).rev() {
            precision[i - 1] = precision[i - 1].max(precision[i]);
        }
        curves.recall[t] = recall.last().copied().unwrap_or(0.0);
        for (i, value) in curves.precision[t].iter_mut().enumerate() {
            let at = recall.partition_point(|r| *r < recall_point(i));
            *value = precision.get(at).copied().unwrap_or(0.0);
        }
    }
    Some(curves)
}
