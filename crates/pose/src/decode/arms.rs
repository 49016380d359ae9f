//! An arm is chosen as a whole.
//!
//! Limb by limb, greedy matching gives an elbow to the limb that scores best there, whatever that costs the wrist beyond it: of two
//! hands near each other the wrong one is taken, or the arm ends early. Here the candidates of shoulder, elbow and wrist are
//! chosen together, so that the ranks of the limbs from the neck on have the largest sum: the best path through a chain of
//! three layers, found by dynamic programming (Viterbi 1967; for bodies Felzenszwalb and Huttenlocher, *Pictorial
//! Structures for Object Recognition*, 2005). A path uses only limbs that the field supports, and only candidates that no
//! other person has.

use super::{
    assemble::{Body, Connection},
    peaks::Peak,
};
use crate::{Part, Skeleton};

/// The parts of each arm, from the neck outwards.
const ARMS: [[Part; 4]; 2] = [
    [Part::Neck, Part::RightShoulder, Part::RightElbow, Part::RightWrist],
    [Part::Neck, Part::LeftShoulder, Part::LeftElbow, Part::LeftWrist],
];

/// One arm of a skeleton: neck, shoulder, elbow and wrist, and the limbs between them, as indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Arm {
    pub(crate) parts: [usize; 4],
    pub(crate) limbs: [usize; 3],
}

impl Arm {
    /// The arms of which every limb is among `limbs`, drawn from the neck outwards.
    pub(crate) fn of(skeleton: Skeleton, limbs: &[[usize; 2]]) -> Vec<Self> {
        let arm = |names: [Part; 4]| {
            let mut parts = [0; 4];
            for (slot, name) in parts.iter_mut().zip(names) {
                *slot = skeleton.index_of(name)?;
            }
            let mut found = [0; 3];
            for (slot, ends) in found.iter_mut().zip(parts.windows(2)) {
                *slot = limbs.iter().position(|limb| limb == ends)?;
            }
            Some(Self { parts, limbs: found })
        };
        ARMS.into_iter().filter_map(arm).collect()
    }

    /// Chooses the arm of `body` again. `links` are the supported limbs between candidates, for each limb of the card;
    /// `free` says of a part's candidate whether the body may have it.
    pub(crate) fn choose(
        &self,
        body: &mut Body,
        links: &[Vec<Connection>],
        peaks: &[Vec<Peak>],
        free: impl Fn(usize, usize) -> bool,
    ) {
        let mut layers: [Vec<Option<Step>>; 4] = self.parts.map(|part| vec![None; peaks[part].len()]);
        if let Some(neck) = body.parts[self.parts[0]] {
            layers[0][neck] = Some(Step { sum: 0.0, link: None });
        }
        for (depth, (limb, part)) in self.limbs.into_iter().zip(&self.parts[1..]).enumerate() {
            // What the body has without this limb (a shoulder known from the ear) may begin a path.
            if let Some(own) = body.parts[*part] {
                layers[depth + 1][own] = Some(Step { sum: 0.0, link: None });
            }
            for link in links[limb].iter().filter(|link| free(*part, link.to)) {
                let Some(before) = layers[depth][link.from] else { continue };
                let sum = before.sum + link.rank;
                let step = &mut layers[depth + 1][link.to];
                if step.is_none_or(|old| sum > old.sum) {
                    *step = Some(Step { sum, link: Some(*link) });
                }
            }
        }
        let ends = layers.iter().enumerate().flat_map(|(depth, layer)| {
            layer.iter().enumerate().filter_map(move |(candidate, step)| Some((depth, candidate, (*step)?.sum)))
        });
        let Some((depth, end, sum)) = ends.max_by(|a, b| a.2.total_cmp(&b.2)) else { return };
        if sum > 0.0 {
            self.replace(body, &layers[..=depth], end);
        }
    }

    /// Puts the path that ends at candidate `end` of the last layer into the body, in place of what its arm was from where
    /// the path begins.
    fn replace(&self, body: &mut Body, layers: &[Vec<Option<Step>>], end: usize) {
        let (mut first, mut candidate, mut path) = (layers.len() - 1, end, Vec::new());
        while let Some(link) = layers[first][candidate].and_then(|step| step.link) {
            first -= 1;
            candidate = link.from;
            path.push((first, link));
        }
        body.limbs.retain(|(limb, _)| !self.limbs[first..].contains(limb));
        for part in &self.parts[first + 1..] {
            body.parts[*part] = None;
        }
        for (depth, link) in path.into_iter().rev() {
            body.parts[self.parts[depth + 1]] = Some(link.to);
            body.limbs.push((self.limbs[depth], link));
        }
    }
}

/// The best way to a candidate: the sum of ranks, and the last limb; none where the way begins.
#[derive(Debug, Clone, Copy)]
struct Step {
    sum: f32,
    link: Option<Connection>,
}

#[cfg(test)]
mod tests;
