//! Networks that answer with coordinates: MoveNet and BlazePose.

use crate::{Keypoint, Person, Skeleton};

/// A MultiPose entry below this is an empty row; the network always answers with six.
const MIN_PERSON_SCORE: f32 = 0.2;
/// BlazePose's own probability that a person is in the crop.
const MIN_PRESENCE: f32 = 0.5;

/// `(y, x, score)` for each keypoint, y and x as fractions of the tensor's edges.
fn fractions(values: &[f32], width: usize, height: usize, min_score: f32) -> Vec<Option<Keypoint>> {
    values
        .chunks_exact(3)
        .map(|k| {
            (k[2] >= min_score).then(|| Keypoint {
                u_px: k[1] * width as f32 - 0.5,
                v_px: k[0] * height as f32 - 0.5,
                score: k[2].clamp(0.0, 1.0),
            })
        })
        .collect()
}

fn mean_score(keypoints: &[Option<Keypoint>]) -> f32 {
    keypoints.iter().flatten().map(|k| k.score).sum::<f32>() / keypoints.len() as f32
}

/// One person from `17 x 3` numbers. `None` when no keypoint is left.
pub(crate) fn movenet(values: &[f32], width: usize, height: usize, min_score: f32) -> Option<Person> {
    let keypoints = fractions(values, width, height, min_score);
    let score = mean_score(&keypoints);
    (score > 0.0).then_some(Person { skeleton: Skeleton::Coco17, keypoints, score })
}

/// People from rows of `17 x 3` numbers, four of a box and a score; best first.
pub(crate) fn movenet_multi(values: &[f32], width: usize, height: usize, min_score: f32) -> Vec<Person> {
    let joints = Skeleton::Coco17.len() * 3;
    let mut people: Vec<Person> = values
        .chunks_exact(joints + 5)
        .filter(|row| row[joints + 4] >= MIN_PERSON_SCORE)
        .map(|row| Person {
            skeleton: Skeleton::Coco17,
            keypoints: fractions(&row[..joints], width, height, min_score),
            score: row[joints + 4].clamp(0.0, 1.0),
        })
        .filter(|p| p.keypoints.iter().flatten().count() > 0)
        .collect();
    people.sort_by(|a, b| b.score.total_cmp(&a.score));
    people
}

/// One person from 39 landmarks of (x, y, z, visibility, presence), in tensor pixels and logits.
pub(crate) fn blazepose(landmarks: &[f32], presence: f32, min_score: f32) -> Option<Person> {
    let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
    if presence < MIN_PRESENCE {
        return None;
    }
    let keypoints: Vec<Option<Keypoint>> = landmarks
        .chunks_exact(5)
        .take(Skeleton::MediaPipe33.len())
        .map(|l| {
            let score = sigmoid(l[3]).min(sigmoid(l[4]));
            (score >= min_score).then(|| Keypoint { u_px: l[0] - 0.5, v_px: l[1] - 0.5, score })
        })
        .collect();
    let score = mean_score(&keypoints);
    (score > 0.0).then_some(Person { skeleton: Skeleton::MediaPipe33, keypoints, score })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Part;

    #[test]
    fn movenet_rows_are_y_x_score_in_fractions_of_the_edges() {
        let mut values = vec![0.0; 51];
        values[30..33].copy_from_slice(&[0.25, 0.5, 0.9]);
        values[33..36].copy_from_slice(&[0.25, 0.5, 0.09]);
        let person = movenet(&values, 256, 128, 0.1).unwrap();
        let wrist = person.get(Part::RightWrist).unwrap();
        assert_eq!((wrist.u_px, wrist.v_px, wrist.score), (127.5, 31.5, 0.9));
        assert_eq!(person.iter().count(), 1);
        assert!(movenet(&[0.0; 51], 256, 256, 0.1).is_none());
    }

    #[test]
    fn empty_rows_of_multipose_are_nobody() {
        let mut values = vec![0.0; 6 * 56];
        values[56 + 27..56 + 30].copy_from_slice(&[0.5, 0.5, 0.8]);
        values[56 + 55] = 0.7;
        values[112 + 27..112 + 30].copy_from_slice(&[0.5, 0.5, 0.8]);
        values[112 + 55] = 0.1;
        let people = movenet_multi(&values, 256, 256, 0.1);
        assert_eq!(people.len(), 1);
        assert!(people[0].get(Part::LeftWrist).is_some());
    }

    #[test]
    fn people_of_multipose_come_best_first_and_not_without_a_keypoint() {
        let mut values = vec![0.0; 6 * 56];
        for (row, score) in [(0, 0.6), (1, 0.9), (2, 0.7)] {
            values[row * 56 + 55] = score;
            if row != 2 {
                values[row * 56 + 29] = 0.8;
            }
        }
        let scores: Vec<f32> = movenet_multi(&values, 256, 256, 0.1).iter().map(|p| p.score).collect();
        assert_eq!(scores, [0.9, 0.6]);
    }

    #[test]
    fn the_six_points_that_only_help_blazepose_are_no_keypoints() {
        let values: Vec<f32> = (0..39).flat_map(|i| [i as f32, 0.0, 0.0, 3.0, 3.0]).collect();
        assert_eq!(blazepose(&values, 0.9, 0.1).unwrap().keypoints.len(), 33);
    }

    #[test]
    fn blazepose_needs_presence_and_both_logits() {
        let mut values = vec![-20.0; 195];
        values[80..85].copy_from_slice(&[100.0, 50.0, 0.0, 3.0, 0.0]);
        let person = blazepose(&values, 0.9, 0.1).unwrap();
        let wrist = person.get(Part::RightWrist).unwrap();
        assert_eq!((wrist.u_px, wrist.v_px), (99.5, 49.5));
        assert!((wrist.score - 0.5).abs() < 1e-6);
        assert!(blazepose(&values, 0.1, 0.1).is_none());
    }
}
