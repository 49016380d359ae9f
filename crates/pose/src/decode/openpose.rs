//! Part confidence maps and affinity fields to people.
//!
//! Cao, Hidalgo, Simon, Wei, Sheikh, *OpenPose: Realtime Multi-Person 2D Pose Estimation using Part Affinity Fields*
//! (2019): the score of a limb between two candidates `d1`, `d2` is the line integral of the field along it (its eq. 11),
//!
//! ```text
//! E = mean over u in [0, 1] of  L_c((1 - u) d1 + u d2) . (d2 - d1) / |d2 - d1|
//! ```
//!
//! taken here at ten points with bilinear interpolation. Limbs are matched greedily, best first, by
//! `E + 0.1 (S(d1) + S(d2))` with the confidences `S` of both ends: where a faint second maximum lies on a limb, the
//! field alone would prefer it, because the shorter line stays away from the field's blurred end. Limbs are joined into people
//! in the order of the card, but not over a length that no body has; a person is kept when its peaks and limbs together are evidence enough. Where we
//! differ: peaks are refined in the map itself and the map is not enlarged first, which is eight times eight fewer
//! cells to look at; and each person's arms are then chosen again as wholes (`arms`).
//!
//! Cost: linear in the cells, plus (candidates of one part) x (candidates of the next) for each limb. Buffers are kept.

use super::{
    arms::Arm,
    assemble::{self, Body, Connection},
    peaks::{self, Peak},
    proportion,
};
use crate::{
    Keypoint, Person, Skeleton,
    card::{Layout, OpenPoseSpec},
};

/// Candidates of one part that are kept, strongest first. Ten people need ten; noise above it costs time squared.
const MAX_PEAKS: usize = 40;
/// Points of the line integral. OpenPose and its descendants use ten; five misjudge limbs that cross.
const SAMPLES: usize = 10;
/// Share of the points that must support a limb; 0.8 as in OpenPose's published demo code.
const SUPPORT: f32 = 0.8;
/// Points of a limb that may lack support; one more, and the rest of its line need not be looked at.
const MAX_MISSES: usize = 2;
/// Fewer keypoints make no person: two joined parts may be noise, an arm has three.
const MIN_PARTS: usize = 3;
/// Least sum of a person's peaks and limbs: [`MIN_PARTS`] parts at OpenPose's least mean of 0.4. It is a sum and no mean,
/// because many faint parts whose fields agree are a small or distant person, and few are noise.
const MIN_EVIDENCE: f32 = 1.2;
/// Weight of each end's confidence when limbs are ranked, as in OpenPose. At 1 a strong wrist of a neighbour beats the
/// own weak one against the field; at 0 the field alone decides.
const END_WEIGHT: f32 = 0.1;

/// A block of channels in a map tensor with a batch of one.
#[derive(Debug, Clone, Copy)]
pub struct MapView<'a> {
    /// The whole tensor.
    pub data: &'a [f32],
    /// Its memory order.
    pub layout: Layout,
    /// Channels of the whole tensor.
    pub channels: usize,
    /// First channel of the block.
    pub first: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl MapView<'_> {
    /// Copies one channel into a plane of `height * width` cells.
    pub(crate) fn copy_plane(&self, channel: usize, plane: &mut [f32]) {
        let cells = self.width * self.height;
        let c = self.first + channel;
        match self.layout {
            Layout::Nchw => plane.copy_from_slice(&self.data[c * cells..(c + 1) * cells]),
            Layout::Nhwc => {
                for (cell, pixel) in plane.iter_mut().zip(self.data.chunks_exact(self.channels)) {
                    *cell = pixel[c];
                }
            }
        }
    }

    fn at(&self, channel: usize, x: usize, y: usize) -> f32 {
        let c = self.first + channel;
        match self.layout {
            Layout::Nchw => self.data[(c * self.height + y) * self.width + x],
            Layout::Nhwc => self.data[(y * self.width + x) * self.channels + c],
        }
    }
}

/// The affinity field of one limb.
#[derive(Debug, Clone, Copy)]
pub struct Field<'a> {
    /// The tensor.
    pub maps: MapView<'a>,
    /// Channels of the x and y component inside the block.
    pub channels: [usize; 2],
}

impl Field<'_> {
    /// The field at a point, cells, by bilinear interpolation; outside the map it is continued from the border.
    pub fn sample(&self, x: f32, y: f32) -> [f32; 2] {
        let (w, h) = (self.maps.width, self.maps.height);
        let (x, y) = (x.clamp(0.0, (w - 1) as f32), y.clamp(0.0, (h - 1) as f32));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        self.channels.map(|c| {
            let top = self.maps.at(c, x0, y0) * (1.0 - fx) + self.maps.at(c, x1, y0) * fx;
            let bottom = self.maps.at(c, x0, y1) * (1.0 - fx) + self.maps.at(c, x1, y1) * fx;
            top * (1.0 - fy) + bottom * fy
        })
    }

    /// Mean of the field along a line, and the share of its points where the field is at least `threshold`.
    pub fn line(&self, from: Peak, to: Peak, threshold: f32) -> (f32, f32) {
        self.supported_line(from, to, threshold, SAMPLES).unwrap_or_default()
    }

    /// As [`Field::line`]; nothing as soon as more than `misses` of the [`SAMPLES`] points are below the threshold.
    fn supported_line(&self, from: Peak, to: Peak, threshold: f32, misses: usize) -> Option<(f32, f32)> {
        let (dx, dy) = (to.x - from.x, to.y - from.y);
        let length = dx.hypot(dy);
        if length < 1e-3 {
            // Two parts in one place have no direction; only the field's strength can speak for them.
            let [lx, ly] = self.sample(from.x, from.y);
            let strength = lx.hypot(ly);
            return Some((strength, f32::from(u8::from(strength >= threshold))));
        }
        let (ux, uy) = (dx / length, dy / length);
        let (mut sum, mut support) = (0.0, 0);
        for i in 0..SAMPLES {
            let u = i as f32 / (SAMPLES - 1) as f32;
            let [lx, ly] = self.sample(from.x + u * dx, from.y + u * dy);
            let along = lx * ux + ly * uy;
            sum += along;
            support += usize::from(along >= threshold);
            if i + 1 > support + misses {
                return None;
            }
        }
        Some((sum / SAMPLES as f32, support as f32 / SAMPLES as f32))
    }
}

/// Decodes the maps of one network; keeps its buffers.
#[derive(Debug, Clone)]
pub struct OpenPoseDecoder {
    skeleton: Skeleton,
    spec: OpenPoseSpec,
    /// From-part and to-part of each limb, as indices of the skeleton.
    limbs: Vec<[usize; 2]>,
    /// Length of each limb in a human, m.
    typical_m: Vec<Option<f32>>,
    arms: Vec<Arm>,
    min_score: f32,
    plane: Vec<f32>,
    peaks: Vec<Vec<Peak>>,
}

impl OpenPoseDecoder {
    /// For the maps that a card describes. Limbs whose parts the skeleton lacks are refused by the card.
    ///
    /// # Panics
    /// When a limb names a part that is not in the skeleton.
    pub fn new(skeleton: Skeleton, spec: &OpenPoseSpec, min_score: f32) -> Self {
        let index = |part| skeleton.index_of(part).unwrap_or_else(|| panic!("{skeleton} has no {part}"));
        let limbs: Vec<_> = spec.limbs.iter().map(|l| [index(l.from), index(l.to)]).collect();
        let typical_m = spec.limbs.iter().map(|l| proportion::typical_m(l.from, l.to)).collect();
        let peaks = vec![Vec::new(); skeleton.len()];
        let arms = Arm::of(skeleton, &limbs);
        Self { skeleton, spec: spec.clone(), limbs, typical_m, arms, min_score, plane: Vec::new(), peaks }
    }

    /// People in tensor coordinates, best first.
    pub fn decode(&mut self, pcm: MapView<'_>, paf: MapView<'_>) -> Vec<Person> {
        self.plane.resize(pcm.width * pcm.height, 0.0);
        for (joint, peaks) in self.peaks.iter_mut().enumerate() {
            pcm.copy_plane(joint, &mut self.plane);
            peaks::find(&self.plane, pcm.width, pcm.height, self.spec.peak_threshold, MAX_PEAKS, peaks);
        }
        let mut supported = Vec::with_capacity(self.limbs.len());
        for (limb, &[from, to]) in self.spec.limbs.iter().zip(&self.limbs) {
            let field = Field { maps: paf, channels: limb.paf };
            supported.push(self.supported(field, from, to, pcm.height));
        }
        let mut connections: Vec<_> =
            supported.iter().zip(&self.limbs).map(|(pairs, limb)| self.match_up(pairs, *limb)).collect();
        let mut bodies = self.assemble(&mut connections);
        self.choose_arms(&mut bodies, &mut supported);
        // By evidence, not by mean score: three sure parts of a neighbour are not more of a person than a whole body is.
        bodies.sort_by(|a, b| self.evidence(b).total_cmp(&self.evidence(a)));
        bodies.iter().filter_map(|body| self.person(body)).collect()
    }

    /// The peaks of the last decoding, for each part, in cells.
    pub fn peaks(&self) -> &[Vec<Peak>] {
        &self.peaks
    }

    /// Joins limbs into bodies, again without a limb that turns out too long for its body, until there is none.
    fn assemble(&self, connections: &mut [Vec<Connection>]) -> Vec<Body> {
        loop {
            let bodies = assemble::assemble(&self.peaks, &self.limbs, connections);
            let Some((limb, wrong)) = self.misfit(&bodies) else { return bodies };
            connections[limb].retain(|c| (c.from, c.to) != (wrong.from, wrong.to));
        }
    }

    /// The first limb that is too long for its body.
    fn misfit(&self, bodies: &[Body]) -> Option<(usize, Connection)> {
        proportion::misfit(bodies, &self.typical_m, |limb, c| {
            let [from, to] = self.limbs[limb];
            let (a, b) = (self.peaks[from][c.from], self.peaks[to][c.to]);
            (a.x - b.x).hypot(a.y - b.y)
        })
    }

    /// Chooses the arms of every person with a neck again, of the one with most evidence first, among what no other of them
    /// has and without limbs that turn out too long for the body. What has no neck is a piece of somebody: it gives way.
    fn choose_arms(&self, bodies: &mut [Body], supported: &mut [Vec<Connection>]) {
        for arm in &self.arms {
            let whole = |body: &Body| body.parts[arm.parts[0]].is_some() && self.person(body).is_some();
            let mut people: Vec<usize> = (0..bodies.len()).filter(|i| whole(&bodies[*i])).collect();
            people.sort_by(|a, b| self.evidence(&bodies[*b]).total_cmp(&self.evidence(&bodies[*a])));
            for &i in &people {
                let others: Vec<&Body> = people.iter().filter(|k| **k != i).map(|k| &bodies[*k]).collect();
                let chosen = loop {
                    let mut body = bodies[i].clone();
                    arm.choose(&mut body, supported, &self.peaks, |part, candidate| {
                        others.iter().all(|other| other.parts[part] != Some(candidate))
                    });
                    let misfit = self.misfit(std::slice::from_ref(&body));
                    let Some((limb, wrong)) = misfit.filter(|(limb, _)| arm.limbs.contains(limb)) else { break body };
                    let before = supported[limb].len();
                    supported[limb].retain(|c| (c.from, c.to) != (wrong.from, wrong.to));
                    if supported[limb].len() == before {
                        break body;
                    }
                };
                for part in arm.parts {
                    let Some(candidate) = chosen.parts[part] else { continue };
                    for (_, other) in bodies.iter_mut().enumerate().filter(|(k, _)| *k != i) {
                        other.release(part, candidate, &self.limbs);
                    }
                }
                bodies[i] = chosen;
            }
        }
    }

    /// Peaks and limbs of a body together.
    fn evidence(&self, body: &Body) -> f32 {
        let peaks = body.parts.iter().zip(&self.peaks).filter_map(|(choice, peaks)| Some(peaks[(*choice)?].score));
        peaks.sum::<f32>() + body.limb_sum()
    }

    /// The pairs of candidates of one limb that the field supports, best first.
    fn supported(&self, field: Field<'_>, from: usize, to: usize, map_height: usize) -> Vec<Connection> {
        let threshold = self.spec.paf_threshold;
        let mut pairs = Vec::new();
        for (i, a) in self.peaks[from].iter().enumerate() {
            for (j, b) in self.peaks[to].iter().enumerate() {
                let line = field.supported_line(*a, *b, threshold, MAX_MISSES);
                let Some((mean, support)) = line else { continue };
                // A limb longer than half the map is penalised, as in OpenPose.
                let length = (a.x - b.x).hypot(a.y - b.y).max(1e-3);
                let score = mean + (0.5 * map_height as f32 / length - 1.0).min(0.0);
                if support >= SUPPORT && score > 0.0 {
                    let rank = score + END_WEIGHT * (a.score + b.score);
                    pairs.push(Connection { from: i, to: j, score, rank });
                }
            }
        }
        pairs.sort_by(|a, b| b.rank.total_cmp(&a.rank));
        pairs
    }

    /// Greedy matching of one limb: best pair first, every candidate once.
    fn match_up(&self, pairs: &[Connection], [from, to]: [usize; 2]) -> Vec<Connection> {
        let mut taken = (vec![false; self.peaks[from].len()], vec![false; self.peaks[to].len()]);
        let free = |p: &&Connection| {
            let free = !taken.0[p.from] && !taken.1[p.to];
            if free {
                taken.0[p.from] = true;
                taken.1[p.to] = true;
            }
            free
        };
        pairs.iter().filter(free).copied().collect()
    }

    fn person(&self, body: &Body) -> Option<Person> {
        let stride = self.spec.stride as f32;
        let to_px = |cell: f32| (cell + 0.5) * stride - 0.5;
        let keypoints: Vec<Option<Keypoint>> = body
            .parts
            .iter()
            .zip(&self.peaks)
            .map(|(choice, peaks)| {
                let peak = peaks[(*choice)?];
                (peak.score >= self.min_score).then(|| Keypoint {
                    u_px: to_px(peak.x),
                    v_px: to_px(peak.y),
                    score: peak.score.min(1.0),
                })
            })
            .collect();
        let found = keypoints.iter().flatten().count();
        if found < MIN_PARTS {
            return None;
        }
        let sum = keypoints.iter().flatten().map(|k| k.score).sum::<f32>();
        let score = sum / found as f32;
        (sum + body.limb_sum() >= MIN_EVIDENCE).then_some(Person { skeleton: self.skeleton, keypoints, score })
    }
}

#[cfg(test)]
mod tests;
