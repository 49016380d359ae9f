//! Starts of the EM: k-means++ seeds, Lloyd iterations, random seeds.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::params::Start;
use crate::kernel::{Blocks, LabelLanes};
use crate::samples::Samples;

/// Lloyd stops when the squared shift of all centres falls below this share of the mean variance.
const LLOYD_TOLERANCE: f64 = 1e-4;
/// Lloyd iterations at most; k-means on motion data settles within a few dozen.
const LLOYD_LIMIT: usize = 300;

/// Hard assignment of each sample to a component.
pub(super) struct Assignment {
    /// The component of each sample, as a number; one for each padded sample of the blocks.
    pub(super) labels: Vec<f64>,
    /// What the assignment was made by, `(k, d)`.
    pub(super) centres: Vec<f64>,
    /// Lloyd iterations done.
    pub(super) iterations: usize,
}

pub(super) fn assign(
    start: &Start,
    blocks: &Blocks,
    samples: &Samples<'_>,
    k: usize,
    rng: &mut ChaCha8Rng,
) -> Assignment {
    let mut centres = match start {
        Start::RandomSamples => random_seeds(samples, k, rng),
        Start::KMeans | Start::KMeansPlusPlus | Start::Mixture(_) => plus_plus_seeds(blocks, samples, k, rng),
    };
    let mut labels = vec![0.0; blocks.padded()];
    let mut iterations = 0;
    if matches!(start, Start::KMeans) {
        iterations = lloyd(blocks, samples, k, &mut centres, &mut labels);
    }
    blocks.nearest(&centres, &mut labels);
    Assignment { labels, centres, iterations }
}

/// Distinct rows with positive weight, uniformly.
fn random_seeds(samples: &Samples<'_>, k: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut candidates: Vec<usize> = (0..samples.len()).filter(|&i| samples.weight(i) > 0.0).collect();
    let mut centres = Vec::with_capacity(k * samples.dim());
    for drawn in 0..k.min(candidates.len()) {
        let pick = rng.random_range(drawn..candidates.len());
        candidates.swap(drawn, pick);
        centres.extend_from_slice(samples.row(candidates[drawn]));
    }
    centres
}

/// Greedy k-means++: each seed is the best of `2 + ln k` draws proportional to the squared
/// distance to the nearest seed so far.
fn plus_plus_seeds(blocks: &Blocks, samples: &Samples<'_>, k: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let n = samples.len();
    let trials = 2 + (k as f64).ln() as usize;
    let weights: Vec<f64> = (0..n).map(|i| samples.weight(i)).collect();
    let mut trial = vec![0.0; blocks.padded()];
    let mut best = vec![0.0; blocks.padded()];
    let mut reach = vec![0.0; n];
    running_sums(&mut reach, weights.iter().copied());
    let mut centres = samples.row(draw(&reach, rng)).to_vec();
    let mut distances = vec![0.0; blocks.padded()];
    blocks.closer(&centres, &vec![f64::INFINITY; blocks.padded()], &mut distances);
    for _ in 1..k {
        running_sums(&mut reach, distances.iter().zip(&weights).map(|(d, w)| d * w));
        let mut best_potential = f64::INFINITY;
        let mut best_index = 0;
        for _ in 0..trials {
            let candidate = draw(&reach, rng);
            let potential = blocks.closer(samples.row(candidate), &distances, &mut trial);
            if potential < best_potential {
                best_potential = potential;
                best_index = candidate;
                std::mem::swap(&mut trial, &mut best);
            }
        }
        centres.extend_from_slice(samples.row(best_index));
        std::mem::swap(&mut distances, &mut best);
    }
    centres
}

/// Moves each cluster without samples to the sample farthest from its own centre.
fn revive(samples: &Samples<'_>, centres: &[f64], labels: &[f64], sums: &mut [f64]) {
    let dim = samples.dim();
    let distance = |i: usize| {
        let centre = &centres[labels[i] as usize * dim..][..dim];
        samples.row(i).iter().zip(centre).map(|(x, c)| (x - c) * (x - c)).sum::<f64>()
    };
    let mut distances: Vec<f64> = (0..samples.len()).map(distance).collect();
    for sum in sums.chunks_exact_mut(dim + 1).filter(|sum| !(sum[0] > 0.0)) {
        let farthest = (0..samples.len())
            .filter(|&i| samples.weight(i) > 0.0)
            .max_by(|&a, &b| distances[a].total_cmp(&distances[b]));
        if let Some(i) = farthest {
            distances[i] = 0.0;
            sum[0] = 1.0;
            sum[1..].copy_from_slice(samples.row(i));
        }
    }
}

fn running_sums(sums: &mut [f64], values: impl Iterator<Item = f64>) {
    let mut total = 0.0;
    for (sum, value) in sums.iter_mut().zip(values) {
        total += value;
        *sum = total;
    }
}

/// Index drawn proportionally to the steps of the running sums `reach`; uniform when these stay zero.
fn draw(reach: &[f64], rng: &mut ChaCha8Rng) -> usize {
    let total = reach.last().copied().unwrap_or(0.0);
    let u: f64 = rng.random();
    if !(total > 0.0) {
        return ((u * reach.len() as f64) as usize).min(reach.len() - 1);
    }
    // The first index whose step reaches beyond `u total`: its own mass is above zero.
    let last = reach.partition_point(|r| *r < total);
    reach.partition_point(|r| *r <= u * total).min(last)
}

/// Lloyd's iterations; a cluster that loses all samples moves to the sample farthest from its centre.
fn lloyd(blocks: &Blocks, samples: &Samples<'_>, k: usize, centres: &mut [f64], labels: &mut [f64]) -> usize {
    let dim = samples.dim();
    let threshold = LLOYD_TOLERANCE * blocks.mean_variance();
    let mut sums = vec![0.0; k * (dim + 1)];
    let mut lanes = LabelLanes::new(k, dim);
    for iteration in 1..=LLOYD_LIMIT {
        blocks.nearest(centres, labels);
        blocks.label_sums(labels, &mut sums, &mut lanes);
        if sums.iter().step_by(dim + 1).any(|mass| !(*mass > 0.0)) {
            revive(samples, centres, labels, &mut sums);
        }
        let mut shift = 0.0;
        for (sum, centre) in sums.chunks_exact(dim + 1).zip(centres.chunks_exact_mut(dim)) {
            for (s, c) in sum[1..].iter().zip(centre) {
                let next = s / sum[0];
                shift += (next - *c) * (next - *c);
                *c = next;
            }
        }
        if shift <= threshold {
            return iteration;
        }
    }
    LLOYD_LIMIT
}
