//! From matched limbs to whole bodies.
//!
//! Limbs are taken in the card's order. A connection joins the body that already has one of its ends, joins two bodies
//! that share no part, or starts a body. A limb whose two parts both occur in earlier limbs (ear to shoulder in the
//! COCO order) only closes a loop: it joins bodies and starts none, because alone it is mostly noise.

use super::peaks::Peak;

/// A matched limb: candidate indices of its two parts, and its score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Connection {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) score: f32,
}

/// For every body and part, the index of the candidate.
pub(crate) fn assemble(
    peaks: &[Vec<Peak>],
    limbs: &[[usize; 2]],
    connections: &[Vec<Connection>],
) -> Vec<Vec<Option<usize>>> {
    let parts = peaks.len();
    let mut bodies: Vec<Vec<Option<usize>>> = Vec::new();
    let mut seen = vec![false; parts];
    for (&[from, to], matched) in limbs.iter().zip(connections) {
        let closes_loop = seen[from] && seen[to];
        seen[from] = true;
        seen[to] = true;
        for c in matched {
            let with_from = bodies.iter().position(|b| b[from] == Some(c.from));
            let with_to = bodies.iter().position(|b| b[to] == Some(c.to));
            match (with_from, with_to) {
                (Some(i), Some(j)) if i != j => {
                    let disjoint = bodies[i].iter().zip(&bodies[j]).all(|(a, b)| a.is_none() || b.is_none());
                    if disjoint {
                        let (keep, drop) = (i.min(j), i.max(j));
                        let other = bodies.swap_remove(drop);
                        for (slot, choice) in bodies[keep].iter_mut().zip(other) {
                            *slot = slot.or(choice);
                        }
                    }
                }
                (Some(i), None) => fill(&mut bodies[i][to], c.to, &peaks[to]),
                (None, Some(j)) => fill(&mut bodies[j][from], c.from, &peaks[from]),
                (None, None) if !closes_loop => {
                    let mut body = vec![None; parts];
                    body[from] = Some(c.from);
                    body[to] = Some(c.to);
                    bodies.push(body);
                }
                // Both ends are in one body already, or a loop would start one.
                (Some(_), Some(_)) | (None, None) => {}
            }
        }
    }
    bodies
}

/// A part that is there already stays, unless the new candidate is stronger.
fn fill(slot: &mut Option<usize>, candidate: usize, peaks: &[Peak]) {
    if slot.is_none_or(|old| peaks[candidate].score > peaks[old].score) {
        *slot = Some(candidate);
    }
}
