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
