//! From labels and people to scores.

use std::collections::BTreeMap;
use std::fmt;

use pose::{
    COCO_17_SIGMAS, DetectedPose, LabelledPose, OksParams, OksSummary, Part, PckCounts, Person, Side, Skeleton, Subset,
    pck,
};
use serde::Serialize;

use super::labels::Label;
use crate::error::Error;

/// Everything that was compared, picture by picture.
#[derive(Debug)]
pub(super) struct Scores {
    skeleton: Skeleton,
    sigmas: Vec<f64>,
    labels: Vec<LabelledPose>,
    detections: Vec<DetectedPose>,
    /// Without a size a label has no OKS.
    sized: bool,
    pictures: u64,
    groups: BTreeMap<String, Matches>,
}

/// Labels and what was found in their place.
#[derive(Debug, Default)]
struct Matches {
    labels: Vec<Label>,
    found: Vec<Vec<Option<[f64; 2]>>>,
}

/// OKS of one subset.
#[derive(Debug, Clone, Serialize)]
pub(super) struct OksRow {
    subset: &'static str,
    #[serde(flatten)]
    summary: OksSummary,
}

/// PCK of one joint of one group.
#[derive(Debug, Clone, Serialize)]
pub(super) struct PckRow {
    group: String,
    subset: &'static str,
    joint: &'static str,
    labelled: usize,
    pck_01: f64,
    pck_02: f64,
}

impl Scores {
    /// Nothing compared yet. `sigmas` replaces COCO's.
    pub(super) fn new(skeleton: Skeleton, sigmas: Option<&[f64]>) -> Result<Self, Error> {
        let sigmas = match sigmas {
            None => skeleton.parts().iter().map(|p| sigma(*p)).collect(),
            Some(given) if given.len() == skeleton.len() => given.to_vec(),
            Some(given) => {
                let (got, expected) = (given.len(), skeleton.len());
                return Err(Error::Usage(format!("--sigmas: {got} numbers, expected {expected} for {skeleton}")));
            }
        };
        Ok(Self {
            skeleton,
            sigmas,
            labels: Vec::new(),
            detections: Vec::new(),
            sized: true,
            pictures: 0,
            groups: BTreeMap::new(),
        })
    }

    /// Takes a picture: its labels, and the people that were found.
    pub(super) fn add(&mut self, group: &str, labels: &[Label], people: &[Person]) {
        let image_id = self.pictures;
        self.pictures += 1;
        let people: Vec<Person> = people.iter().map(|p| p.to_skeleton(self.skeleton)).collect();
        for person in &people {
            // As COCO's result files have it: a keypoint that was not found lies at (0, 0).
            let place = |k: &Option<pose::Keypoint>| k.map_or([0.0; 2], |k| [k.u_px.into(), k.v_px.into()]);
            let keypoints = person.keypoints.iter().map(place).collect();
            self.detections.push(DetectedPose { image_id, keypoints, score: person.score.into() });
        }
        for label in labels {
            self.sized &= label.size.is_some();
            let (area_px2, box_px) = label.size.unwrap_or_default();
            let keypoints = label.keypoints.clone();
            self.labels.push(LabelledPose { image_id, keypoints, area_px2, box_px, is_crowd: label.is_crowd });
        }
        let single: Vec<&Label> = labels.iter().filter(|l| !l.is_crowd).collect();
        let group = self.groups.entry(group.to_owned()).or_default();
        for (label, person) in single.iter().zip(matching(&single, &people)) {
            let place = |k: &Option<pose::Keypoint>| k.map(|k| [k.u_px.into(), k.v_px.into()]);
            let found = person
                .map_or_else(|| vec![None; self.skeleton.len()], |i| people[i].keypoints.iter().map(place).collect());
            group.labels.push((*label).clone());
            group.found.push(found);
        }
    }

    /// Average precision and recall of all keypoints, the visible, the covered, and the arms; empty where labels have no
    /// size.
    pub(super) fn oks(&self) -> Result<Vec<OksRow>, Error> {
        if !self.sized || self.labels.is_empty() {
            return Ok(Vec::new());
        }
        let arms: Vec<usize> = arm_parts().filter_map(|p| self.skeleton.index_of(p)).collect();
        let subsets = [
            ("all", Subset::default()),
            ("visible", Subset { visibility: Some(2), keypoints: None }),
            ("covered", Subset { visibility: Some(1), keypoints: None }),
            ("arms", Subset { visibility: None, keypoints: Some(arms.clone()) }),
            ("visible arms", Subset { visibility: Some(2), keypoints: Some(arms.clone()) }),
            ("covered arms", Subset { visibility: Some(1), keypoints: Some(arms) }),
        ];
        let mut rows = Vec::new();
        for (name, subset) in subsets {
            let params = OksParams { sigmas: self.sigmas.clone(), subset, ..OksParams::default() };
            let summary = params.evaluate(&self.labels, &self.detections)?;
            if summary.ap.is_some() {
                rows.push(OksRow { subset: name, summary });
            }
        }
        Ok(rows)
    }

    /// PCK by group, subset and joint; joints without a label are left out. The last group is all of them.
    pub(super) fn pck(&self) -> Result<Vec<PckRow>, Error> {
        let mut rows = Vec::new();
        let everything = Matches {
            labels: self.groups.values().flat_map(|m| m.labels.clone()).collect(),
            found: self.groups.values().flat_map(|m| m.found.clone()).collect(),
        };
        let mut groups: Vec<(&str, &Matches)> = self.groups.iter().map(|(name, m)| (name.as_str(), m)).collect();
        if groups.len() > 1 {
            groups.push(("all", &everything));
        }
        for (group, matches) in groups {
            for (subset, visibility) in [("visible", 2.0), ("covered", 1.0)] {
                rows.extend(self.pck_of(group, matches, subset, visibility)?);
            }
        }
        Ok(rows)
    }

    fn pck_of(
        &self,
        group: &str,
        matches: &Matches,
        subset: &'static str,
        visibility: f64,
    ) -> Result<Vec<PckRow>, Error> {
        let truth: Vec<Vec<Option<[f64; 2]>>> = matches
            .labels
            .iter()
            .map(|l| l.keypoints.iter().map(|k| ((k[2] - visibility).abs() < 0.5).then_some([k[0], k[1]])).collect())
            .collect();
        let torso_px: Vec<f64> = matches.labels.iter().map(|l| l.torso_px).collect();
        let [tenth, fifth] = [0.1, 0.2].map(|fraction| pck(&truth, &matches.found, &torso_px, fraction));
        let (tenth, fifth) = (tenth?, fifth?);
        let mut rows = Vec::new();
        let mut arms = [PckCounts::default(); 2];
        for (i, part) in self.skeleton.parts().iter().enumerate() {
            let (Some(tenth), Some(fifth)) = (tenth.get(i), fifth.get(i)) else { continue };
            if arm_parts().any(|p| p == *part) {
                for (sum, count) in arms.iter_mut().zip([tenth, fifth]) {
                    sum.total += count.total;
                    sum.correct += count.correct;
                }
            }
            rows.extend(row(group, subset, part.name(), tenth, fifth));
        }
        let [tenth, fifth] = arms;
        rows.extend(row(group, subset, "arms", &tenth, &fifth));
        Ok(rows)
    }
}

fn row(group: &str, subset: &'static str, joint: &'static str, tenth: &PckCounts, fifth: &PckCounts) -> Option<PckRow> {
    let (pck_01, pck_02) = tenth.share().zip(fifth.share())?;
    Some(PckRow { group: group.to_owned(), subset, joint, labelled: tenth.total, pck_01, pck_02 })
}

fn arm_parts() -> impl Iterator<Item = Part> {
    [Side::Right, Side::Left].into_iter().flat_map(Part::arm)
}

/// COCO's sigma of a part; parts that COCO lacks get that of the nearest kind.
fn sigma(part: Part) -> f64 {
    if let Some(i) = Skeleton::Coco17.index_of(part) {
        return COCO_17_SIGMAS[i];
    }
    let name = part.name();
    let like = |p: Part| Skeleton::Coco17.index_of(p).map_or(COCO_17_SIGMAS[0], |i| COCO_17_SIGMAS[i]);
    match part {
        Part::Neck => like(Part::LeftShoulder),
        Part::MidHip => like(Part::LeftHip),
        _ if name.contains("eye") || name.contains("mouth") => like(Part::LeftEye),
        _ if ["pinky", "index", "thumb"].iter().any(|k| name.ends_with(k)) && !name.contains("foot") => {
            like(Part::LeftWrist)
        }
        _ => like(Part::LeftAnkle),
    }
}

/// For each label the person that fits it best: pairs in order of mean distance, each person once. A joint that is
/// missing, and any that is further off, counts as one torso.
fn matching(labels: &[&Label], people: &[Person]) -> Vec<Option<usize>> {
    let mut pairs = Vec::new();
    for (l, label) in labels.iter().enumerate() {
        for (p, person) in people.iter().enumerate() {
            let distances: Vec<f64> = label
                .keypoints
                .iter()
                .zip(&person.keypoints)
                .filter(|(k, _)| k[2] > 0.0)
                .map(|(k, found)| {
                    let apart = found.map(|f| (f64::from(f.u_px) - k[0]).hypot(f64::from(f.v_px) - k[1]));
                    apart.map_or(1.0, |d| (d / label.torso_px).min(1.0))
                })
                .collect();
            let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
            if mean < 1.0 {
                pairs.push((mean, l, p));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen = vec![None; labels.len()];
    let mut taken = vec![false; people.len()];
    for (_, l, p) in pairs {
        if chosen[l].is_none() && !taken[p] {
            chosen[l] = Some(p);
            taken[p] = true;
        }
    }
    chosen
}

impl fmt::Display for OksRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |x: Option<f64>| x.map_or_else(|| "    -".to_owned(), |x| format!("{:5.1}", 100.0 * x));
        let s = &self.summary;
        write!(f, "{:14}", self.subset)?;
        for x in [s.ap, s.ap_50, s.ap_75, s.ap_medium, s.ap_large, s.ar, s.ar_50, s.ar_75] {
            write!(f, " {:>6}", percent(x))?;
        }
        Ok(())
    }
}

impl fmt::Display for PckRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { group, subset, joint, labelled, pck_01, pck_02 } = self;
        write!(f, "{group:10} {subset:8} {joint:16} {labelled:7} {:8.1} {:8.1}", 100.0 * pck_01, 100.0 * pck_02)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(u: f32, v: f32) -> Person {
        let keypoints = (0..17)
            .map(|i| Some(pose::Keypoint { u_px: u + i as f32, v_px: v + 2.0 * i as f32, score: 0.9 }))
            .collect();
        Person { skeleton: Skeleton::Coco17, keypoints, score: 0.9 }
    }

    fn label(u: f64, v: f64) -> Label {
        let keypoints = (0..17).map(|i| [u + f64::from(i), v + 2.0 * f64::from(i), 2.0]).collect();
        Label { keypoints, size: Some((2000.0, [u, v, 17.0, 34.0])), is_crowd: false, torso_px: 50.0 }
    }

    #[test]
    fn exact_people_score_everything_in_any_order_and_a_miss_costs_recall_and_pck() {
        let mut scores = Scores::new(Skeleton::Coco17, None).unwrap();
        let mut covered = label(200.0, 10.0);
        covered.keypoints[10][2] = 1.0;
        scores.add("a", &[label(10.0, 10.0), covered], &[person(200.0, 10.0), person(10.0, 10.0)]);
        let ap = |scores: &Scores, i: usize| scores.oks().unwrap()[i].summary.ap.unwrap();
        assert!((ap(&scores, 0) - 1.0).abs() < 1e-9);
        let rows = scores.pck().unwrap();
        let wrist: Vec<_> = rows.iter().filter(|r| r.joint == "right_wrist").map(|r| (r.subset, r.labelled)).collect();
        assert_eq!(wrist, [("visible", 1), ("covered", 1)]);
        assert!(rows.iter().all(|r| (r.pck_01 - 1.0).abs() < 1e-12));
        // One of two people found.
        scores.add("b", &[label(10.0, 10.0)], &[]);
        assert!((scores.oks().unwrap()[0].summary.ar.unwrap() - 2.0 / 3.0).abs() < 1e-9);
        let rows = scores.pck().unwrap();
        let all = rows.iter().find(|r| r.group == "all" && r.subset == "visible" && r.joint == "arms").unwrap();
        assert_eq!((all.labelled, (all.pck_02 * 1000.0).round()), (17, 647.0));
    }

    #[test]
    fn a_keypoint_fifteen_percent_of_the_torso_off_is_right_at_a_fifth_only() {
        let mut scores = Scores::new(Skeleton::Coco17, None).unwrap();
        let mut person = person(10.0, 10.0);
        if let Some(k) = &mut person.keypoints[9] {
            k.u_px += 7.5;
        }
        scores.add("a", &[label(10.0, 10.0)], &[person]);
        let rows = scores.pck().unwrap();
        let wrist = rows.iter().find(|r| r.joint == "left_wrist").unwrap();
        assert_eq!((wrist.pck_01.round() as i32, wrist.pck_02.round() as i32), (0, 1));
    }

    #[test]
    fn sigmas_of_another_length_are_refused_and_unsized_labels_have_no_oks() {
        assert!(Scores::new(Skeleton::Coco17, Some(&[0.1; 16])).unwrap_err().to_string().contains("expected 17"));
        let mut scores = Scores::new(Skeleton::Coco17, None).unwrap();
        scores.add("a", &[Label { size: None, ..label(0.0, 0.0) }], &[person(0.0, 0.0)]);
        assert!(scores.oks().unwrap().is_empty());
    }
}
