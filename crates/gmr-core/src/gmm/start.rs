//! Starts of the EM: k-means++ seeds, Lloyd iterations, random seeds.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::params::Start;
use crate::kernel::Blocks;
use crate::samples::Samples;

/// Lloyd stops when the squared shift of all centres falls below this share of the mean variance.
const LLOYD_TOLERANCE: f64 = 1e-4;
/// Lloyd iterations at most; k-means on motion data settles within a few dozen.
const LLOYD_LIMIT: usize = 300;

/// Hard assignment of each sample to a component.
pub(super) struct Assignment {
    pub(super) labels: Vec<u32>,
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
    let mut labels = vec![0; samples.len()];
    let mut distances = vec![0.0; samples.len()];
    let mut iterations = 0;
    if matches!(start, Start::KMeans) {
        iterations = lloyd(blocks, samples, k, &mut centres, &mut labels, &mut distances);
    }
    blocks.nearest(&centres, &mut labels, &mut distances);
    Assignment { labels, iterations }
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
    let mut labels = vec![0; n];
    let mut distances = vec![0.0; n];
    let mut trial = vec![0.0; n];
    let mut best = vec![0.0; n];
    let first = draw(&weights, rng);
    let mut centres = samples.row(first).to_vec();
    blocks.nearest(&centres, &mut labels, &mut distances);
    let mut mass: Vec<f64> = distances.iter().zip(&weights).map(|(d, w)| d * w).collect();
    for _ in 1..k {
        let mut best_potential = f64::INFINITY;
        let mut best_index = 0;
        for _ in 0..trials {
            let candidate = draw(&mass, rng);
            blocks.nearest(samples.row(candidate), &mut labels, &mut trial);
            let mut potential = 0.0;
            for ((t, d), w) in trial.iter_mut().zip(&distances).zip(&weights) {
                *t = t.min(*d);
                potential += *t * w;
            }
            if potential < best_potential {
                best_potential = potential;
                best_index = candidate;
                std::mem::swap(&mut trial, &mut best);
            }
        }
        centres.extend_from_slice(samples.row(best_index));
        distances.copy_from_slice(&best);
        for ((m, d), w) in mass.iter_mut().zip(&distances).zip(&weights) {
            *m = d * w;
        }
    }
    centres
}

/// Index drawn proportionally to `mass`; uniform when all mass is zero.
fn draw(mass: &[f64], rng: &mut ChaCha8Rng) -> usize {
    let total: f64 = mass.iter().sum();
    let u: f64 = rng.random();
    if !(total > 0.0) {
        return ((u * mass.len() as f64) as usize).min(mass.len() - 1);
    }
    let mut left = u * total;
    let mut last = 0;
    for (i, m) in mass.iter().enumerate() {
        if *m > 0.0 {
            last = i;
            left -= m;
            if left < 0.0 {
                return i;
            }
        }
    }
    last
}

/// Lloyd's iterations; a cluster that loses all samples moves to the sample farthest from its centre.
fn lloyd(
    blocks: &Blocks,
    samples: &Samples<'_>,
    k: usize,
    centres: &mut [f64],
    labels: &mut [u32],
    distances: &mut [f64],
) -> usize {
    let dim = samples.dim();
    let threshold = LLOYD_TOLERANCE * mean_variance(samples);
    for iteration in 1..=LLOYD_LIMIT {
        blocks.nearest(centres, labels, distances);
        let mut sums = blocks.label_sums(labels, k);
        for c in 0..k {
            if sums[c * (dim + 1)] > 0.0 {
                continue;
            }
            let farthest = (0..samples.len())
                .filter(|&i| samples.weight(i) > 0.0)
                .max_by(|&a, &b| distances[a].total_cmp(&distances[b]));
            if let Some(i) = farthest {
                distances[i] = 0.0;
                sums[c * (dim + 1)] = 1.0;
                sums[c * (dim + 1) + 1..(c + 1) * (dim + 1)].copy_from_slice(samples.row(i));
            }
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

/// Mean over columns of the sample variance.
fn mean_variance(samples: &Samples<'_>) -> f64 {
    let (n, d) = (samples.len() as f64, samples.dim());
    let mut mean = vec![0.0; d];
    for row in samples.values().chunks_exact(d) {
        for (m, v) in mean.iter_mut().zip(row) {
            *m += v / n;
        }
    }
    let mut total = 0.0;
    for row in samples.values().chunks_exact(d) {
        for (m, v) in mean.iter().zip(row) {
            total += (v - m) * (v - m) / n;
        }
    }
    total / d as f64
}
