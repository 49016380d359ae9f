//! Lengths that a human body cannot have.
//!
//! Fields of people in one line support a limb from one to another. Such a limb is far longer, measured in the length that it
//! has in a human, than every other limb of its body. Foreshortening only makes limbs shorter, so a limb that is the
//! longest by a factor of [`TOO_LONG`] is no limb of that body.

use super::assemble::{Body, Connection};
use crate::Part;

/// The other limbs of a body may all point at the camera within 70 degrees before a true limb is this much longer.
const TOO_LONG: f32 = 3.0;
/// Slack for peaks that are a cell off at both ends, cells: a face may be one cell wide.
const SLACK: f32 = 2.0;
/// With fewer limbs nobody can say which one is wrong.
const MIN_LIMBS: usize = 4;

/// Length of a limb of an adult, m, to a tenth; `None` for a pair that is not listed. From the body segment lengths of Drillis
/// and Contini (1966) at a stature of 1.75 m; those of the head are rounded from portraits.
pub(crate) fn typical_m(from: Part, to: Part) -> Option<f32> {
    fn middle(part: Part) -> &'static str {
        part.name().trim_start_matches("left_").trim_start_matches("right_")
    }
    let pair = |a: &str, b: &str| (middle(from), middle(to)) == (a, b) || (middle(from), middle(to)) == (b, a);
    let table = [
        ("neck", "shoulder", 0.23),
        ("shoulder", "elbow", 0.33),
        ("elbow", "wrist", 0.26),
        ("neck", "hip", 0.52),
        ("shoulder", "hip", 0.5),
        ("hip", "knee", 0.43),
        ("knee", "ankle", 0.43),
        ("neck", "nose", 0.22),
        ("nose", "eye", 0.05),
        ("eye", "ear", 0.12),
        ("nose", "ear", 0.15),
        ("shoulder", "ear", 0.25),
        ("shoulder", "shoulder", 0.45),
        ("hip", "hip", 0.33),
    ];
    table.into_iter().find(|(a, b, _)| pair(a, b)).map(|(_, _, length)| length)
}

/// The first limb that is too long for its body. `length` is that of a connection in cells, `typical_m` that of each limb.
pub(crate) fn misfit(
    bodies: &[Body],
    typical_m: &[Option<f32>],
    length: impl Fn(usize, &Connection) -> f32,
) -> Option<(usize, Connection)> {
    for body in bodies.iter().filter(|b| b.limbs.len() >= MIN_LIMBS) {
        let scale = |(limb, c): &(usize, Connection), less: f32| {
            typical_m[*limb].map(|typical| (length(*limb, c) - less).max(0.0) / typical)
        };
        for (i, limb) in body.limbs.iter().enumerate() {
            let others = body.limbs.iter().enumerate().filter(|(k, _)| *k != i).filter_map(|(_, l)| scale(l, 0.0));
            let longest = others.fold(0.0, f32::max);
            if longest > 0.0 && scale(limb, SLACK).is_some_and(|s| s > TOO_LONG * longest) {
                return Some(*limb);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The limb that is found too long in a body of limbs of one typical length, and of these lengths in cells.
    fn misfit_of(lengths: &[f32]) -> Option<usize> {
        let limb = |i| (i, Connection { from: 0, to: 0, score: 1.0, rank: 1.0 });
        let body = Body { parts: Vec::new(), limbs: (0..lengths.len()).map(limb).collect() };
        let typical = vec![Some(0.3); lengths.len()];
        misfit(&[body], &typical, |i, _| lengths[i]).map(|(i, _)| i)
    }

    #[test]
    fn a_limb_is_too_long_from_three_times_the_longest_other_and_two_cells_on() {
        assert_eq!(misfit_of(&[10.0, 9.0, 33.0, 4.0]), Some(2));
        assert_eq!(misfit_of(&[10.0, 9.0, 31.0, 4.0]), None);
        // Three limbs do not say which of them is wrong, and limbs of no length say nothing.
        assert_eq!(misfit_of(&[10.0, 9.0, 90.0]), None);
        assert_eq!(misfit_of(&[0.0, 0.0, 90.0, 0.0]), None);
    }

    #[test]
    fn limbs_are_compared_in_the_lengths_that_they_have_in_a_human() {
        let limb = |i| (i, Connection { from: 0, to: 0, score: 1.0, rank: 1.0 });
        let body = Body { parts: Vec::new(), limbs: (0..4).map(limb).collect() };
        // An upper arm that is long for the eyes beside it; without a typical length nothing is known.
        let (arm, eye) = (typical_m(Part::LeftShoulder, Part::LeftElbow), typical_m(Part::Nose, Part::LeftEye));
        let length = |i: usize, _: &Connection| if i == 0 { 33.0 } else { 5.0 };
        assert_eq!(misfit(std::slice::from_ref(&body), &[arm, eye, eye, eye], length), None);
        assert_eq!(misfit(std::slice::from_ref(&body), &[arm; 4], length).map(|(i, _)| i), Some(0));
        assert_eq!(misfit(&[body], &[None, arm, arm, arm], length), None);
        assert_eq!(typical_m(Part::LeftWrist, Part::Nose), None);
    }

    /// Judge: the segments as fractions of the stature, 1.75 m, as Drillis and Contini give them.
    #[test]
    fn lengths_are_those_of_the_published_segments() {
        let (half_shoulders, half_hips, trunk) = (0.129, 0.0955, 0.818 - 0.530_f32);
        let pairs = [
            (Part::Neck, Part::LeftShoulder, half_shoulders),
            (Part::LeftShoulder, Part::RightShoulder, 2.0 * half_shoulders),
            (Part::RightElbow, Part::RightShoulder, 0.186),
            (Part::LeftElbow, Part::LeftWrist, 0.146),
            (Part::Neck, Part::LeftHip, trunk.hypot(half_hips)),
            (Part::RightShoulder, Part::RightHip, trunk),
            (Part::LeftHip, Part::RightHip, 2.0 * half_hips),
            (Part::LeftHip, Part::LeftKnee, 0.245),
            (Part::LeftKnee, Part::LeftAnkle, 0.246),
        ];
        for (from, to, fraction) in pairs {
            let typical = typical_m(from, to).unwrap();
            assert!((typical - 1.75 * fraction).abs() < 0.02, "{from} {to}: {typical} {}", 1.75 * fraction);
        }
    }
}
