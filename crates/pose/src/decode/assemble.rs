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
    /// Line integral of the field, less what a great length costs.
    pub(crate) score: f32,
    /// By which limbs are ranked: `score` and a share of the two peaks.
    pub(crate) rank: f32,
}

/// What belongs together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Body {
    /// For every part, the index of the candidate.
    pub(crate) parts: Vec<Option<usize>>,
    /// The limbs that joined it: index and connection.
    pub(crate) limbs: Vec<(usize, Connection)>,
}

/// All bodies, in the order in which they were started.
pub(crate) fn assemble(peaks: &[Vec<Peak>], limbs: &[[usize; 2]], connections: &[Vec<Connection>]) -> Vec<Body> {
    let parts = peaks.len();
    let mut bodies: Vec<Body> = Vec::new();
    let mut seen = vec![false; parts];
    for (limb, (&[from, to], matched)) in limbs.iter().zip(connections).enumerate() {
        let closes_loop = seen[from] && seen[to];
        seen[from] = true;
        seen[to] = true;
        for c in matched {
            let with_from = bodies.iter().position(|b| b.parts[from] == Some(c.from));
            let with_to = bodies.iter().position(|b| b.parts[to] == Some(c.to));
            match (with_from, with_to) {
                (Some(i), Some(j)) if i != j => {
                    let pairs = bodies[i].parts.iter().zip(&bodies[j].parts);
                    if pairs.into_iter().all(|(a, b)| a.is_none() || b.is_none()) {
                        let (keep, drop) = (i.min(j), i.max(j));
                        let other = bodies.swap_remove(drop);
                        for (slot, choice) in bodies[keep].parts.iter_mut().zip(other.parts) {
                            *slot = slot.or(choice);
                        }
                        bodies[keep].limbs.extend(other.limbs);
                        bodies[keep].limbs.push((limb, *c));
                    }
                }
                (Some(i), None) => bodies[i].fill((to, c.to), (limb, *c), &peaks[to]),
                (None, Some(j)) => bodies[j].fill((from, c.from), (limb, *c), &peaks[from]),
                (None, None) if !closes_loop => {
                    let mut body = Body { parts: vec![None; parts], limbs: vec![(limb, *c)] };
                    body.parts[from] = Some(c.from);
                    body.parts[to] = Some(c.to);
                    bodies.push(body);
                }
                // Both ends are in one body already, or a loop would start one.
                (Some(_), Some(_)) | (None, None) => {}
            }
        }
    }
    bodies
}

impl Body {
    /// Scores of its limbs, summed.
    pub(crate) fn limb_sum(&self) -> f32 {
        self.limbs.iter().map(|(_, c)| c.score).sum()
    }

    /// Gives up a candidate, and every limb that ends there.
    pub(crate) fn release(&mut self, part: usize, candidate: usize, limbs: &[[usize; 2]]) {
        if self.parts[part] != Some(candidate) {
            return;
        }
        self.parts[part] = None;
        self.limbs.retain(|(limb, _)| !limbs[*limb].contains(&part));
    }

    /// A part that is there already stays, unless the new candidate is stronger.
    fn fill(&mut self, (part, candidate): (usize, usize), limb: (usize, Connection), peaks: &[Peak]) {
        match &mut self.parts[part] {
            Some(old) if peaks[candidate].score <= peaks[*old].score => {}
            Some(old) => *old = candidate,
            slot @ None => {
                *slot = Some(candidate);
                self.limbs.push(limb);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(from: usize, to: usize, score: f32) -> Connection {
        Connection { from, to, score, rank: score }
    }

    /// Candidates of these scores, for each part.
    fn peaks(scores: &[&[f32]]) -> Vec<Vec<Peak>> {
        scores.iter().map(|s| s.iter().map(|score| Peak { x: 0.0, y: 0.0, score: *score }).collect()).collect()
    }

    #[test]
    fn two_bodies_without_a_common_part_become_one_with_the_limbs_and_the_evidence_of_both() {
        let limbs = [[0, 1], [2, 3], [3, 4], [1, 2]];
        let matched =
            [vec![joined(0, 0, 0.5)], vec![joined(0, 0, 0.7)], vec![joined(0, 0, 0.1)], vec![joined(0, 0, 0.3)]];
        let bodies = assemble(&peaks(&[&[0.9][..]; 5]), &limbs, &matched);
        assert_eq!(bodies.len(), 1);
        assert_eq!(bodies[0].parts, [Some(0); 5]);
        assert!((bodies[0].limb_sum() - 1.6).abs() < 1e-6, "{}", bodies[0].limb_sum());
        let mut limbs: Vec<usize> = bodies[0].limbs.iter().map(|(limb, _)| *limb).collect();
        limbs.sort_unstable();
        assert_eq!(limbs, [0, 1, 2, 3]);
    }

    /// Both have part 0, so the limb from the one's part 1 to the other's part 2 is between two people.
    #[test]
    fn two_bodies_with_a_common_part_stay_two() {
        let limbs = [[0, 1], [0, 2], [1, 2]];
        let matched = [vec![joined(0, 0, 0.5)], vec![joined(1, 0, 0.5)], vec![joined(0, 0, 0.9)]];
        let bodies = assemble(&peaks(&[&[0.9, 0.9], &[0.9], &[0.9]]), &limbs, &matched);
        let parts: Vec<_> = bodies.into_iter().map(|b| b.parts).collect();
        assert_eq!(parts, [vec![Some(0), Some(0), None], vec![Some(1), None, Some(0)]]);
    }

    #[test]
    fn a_limb_that_closes_a_loop_starts_no_body() {
        let limbs = [[0, 1], [1, 2], [0, 2]];
        let matched = [vec![joined(0, 0, 0.5)], vec![joined(0, 0, 0.5)], vec![joined(1, 1, 0.9)]];
        let bodies = assemble(&peaks(&[&[0.9, 0.9], &[0.9], &[0.9, 0.9]]), &limbs, &matched);
        assert_eq!((bodies.len(), &bodies[0].parts[..]), (1, &[Some(0); 3][..]));
    }

    #[test]
    fn what_is_given_up_goes_with_its_limbs() {
        let limbs = [[0, 1], [1, 2], [2, 3]];
        let matched = [vec![joined(0, 0, 0.5)], vec![joined(0, 1, 0.25)], vec![joined(1, 0, 0.125)]];
        let mut body = assemble(&peaks(&[&[0.9], &[0.9], &[0.9, 0.9], &[0.9]]), &limbs, &matched).remove(0);
        body.release(2, 0, &limbs);
        assert_eq!((body.limbs.len(), body.limb_sum()), (3, 0.875), "another candidate is not the body's");
        body.release(2, 1, &limbs);
        assert_eq!(body.parts, [Some(0), Some(0), None, Some(0)]);
        assert_eq!(body.limbs, [(0, matched[0][0])]);
    }

    #[test]
    fn a_part_that_is_there_gives_way_to_a_stronger_candidate_only() {
        let limbs = [[0, 1], [1, 2], [0, 2]];
        let matched = [vec![joined(0, 0, 0.5)], vec![joined(0, 0, 0.5)], vec![joined(0, 1, 0.9)]];
        for (other, kept) in [(0.4, 0), (0.6, 1)] {
            let bodies = assemble(&peaks(&[&[0.9], &[0.9], &[0.5, other]]), &limbs, &matched);
            assert_eq!(bodies[0].parts[2], Some(kept), "{other}");
        }
    }
}
