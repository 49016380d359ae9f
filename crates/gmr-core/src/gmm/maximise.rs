//! The M step.

use super::mixture::MixtureParts;
use super::params::{CovarianceKind, GmmParams};
use super::report::{Floored, RestartOutcome};
use crate::fusion::{Fusion, FusionStep};
use crate::kernel::Moments;
use crate::linalg::clip_eigenvalues;

/// A component whose share of the total weight falls below this has no samples left.
const EMPTY_SHARE: f64 = 1e-10;
/// Moments about the old mean lose `log10(shift^2 / variance)` digits; beyond three the pass is
/// repeated about the new mean.
const RECENTRE_RATIO: f64 = 1e3;

/// Moves `centres` to the new means when some component has moved by many of its new deviations.
pub(super) fn recentre(moments: &Moments, centres: &mut [f64], d: usize) -> bool {
    let far = moments.mass.iter().enumerate().any(|(c, mass)| {
        *mass > 0.0
            && (0..d).any(|j| {
                let shift = moments.first[c * d + j] / mass;
                let spread = moments.second[(c * d + j) * d + j] / mass - shift * shift;
                shift * shift > RECENTRE_RATIO * spread
            })
    });
    if far {
        for (c, mass) in moments.mass.iter().enumerate().filter(|(_, m)| **m > 0.0) {
            for j in 0..d {
                centres[c * d + j] += moments.first[c * d + j] / mass;
            }
        }
    }
    far
}

/// The M step: weights, means and covariances from moments about `centres`, into `parts`.
pub(super) fn maximise(
    params: &GmmParams,
    moments: &Moments,
    centres: &[f64],
    fusion: Option<(&Fusion<'_>, &mut Vec<FusionStep>)>,
    iteration: usize,
    floored: &mut Vec<Floored>,
    parts: &mut MixtureParts,
) -> std::result::Result<(), RestartOutcome> {
    let (k, d) = (moments.mass.len(), moments.dim);
    let MixtureParts { weights, means, covariances, .. } = parts;
    let mass_sum: f64 = moments.mass.iter().sum();
    for (component, mass) in moments.mass.iter().enumerate() {
        if !(*mass > EMPTY_SHARE * mass_sum) {
            return Err(RestartOutcome::EmptyComponent { component, iteration, share: mass / mass_sum });
        }
    }
    weights.clear();
    weights.extend(moments.mass.iter().map(|m| m / mass_sum));
    means.clear();
    means.extend_from_slice(centres);
    covariances.resize(k * d * d, 0.0);
    for (c, (mean, scatter)) in means.chunks_exact_mut(d).zip(covariances.chunks_exact_mut(d * d)).enumerate() {
        let first = &moments.first[c * d..(c + 1) * d];
        let second = &moments.second[c * d * d..(c + 1) * d * d];
        centred(first, second, moments.mass[c], mean, scatter);
    }
    if let Some((fusion, steps)) = fusion {
        let reliability: Vec<f64> = moments.extra.iter().zip(&moments.mass).map(|(e, m)| e / m).collect();
        steps.push(fusion.apply(weights, &reliability));
    }
    match params.covariance {
        CovarianceKind::Full => {}
        CovarianceKind::Tied => {
            let mut pooled = vec![0.0; d * d];
            for (matrix, weight) in covariances.chunks_exact(d * d).zip(&*weights) {
                for (p, v) in pooled.iter_mut().zip(matrix) {
                    *p += weight * v;
                }
            }
            *covariances = pooled;
        }
        CovarianceKind::Diagonal => *covariances = (0..k * d).map(|i| covariances[i * d + i % d]).collect(),
        CovarianceKind::Spherical => {
            let trace = |m: &[f64]| (0..d).map(|i| m[i * d + i]).sum::<f64>();
            *covariances = covariances.chunks_exact(d * d).map(|m| trace(m) / d as f64).collect();
        }
    }
    regularise(params, covariances, d, iteration, floored);
    Ok(())
}

/// Moves `mean` by the first moment and sets `scatter` to the second moment about the new mean.
fn centred(first: &[f64], second: &[f64], mass: f64, mean: &mut [f64], scatter: &mut [f64]) {
    // One copy of the loops per small dimension, so that they unroll.
    match first.len() {
        1 => centred_of(1, first, second, mass, mean, scatter),
        2 => centred_of(2, first, second, mass, mean, scatter),
        3 => centred_of(3, first, second, mass, mean, scatter),
        4 => centred_of(4, first, second, mass, mean, scatter),
        5 => centred_of(5, first, second, mass, mean, scatter),
        6 => centred_of(6, first, second, mass, mean, scatter),
        7 => centred_of(7, first, second, mass, mean, scatter),
        8 => centred_of(8, first, second, mass, mean, scatter),
        d => centred_of(d, first, second, mass, mean, scatter),
    }
}

#[inline(always)]
fn centred_of(d: usize, first: &[f64], second: &[f64], mass: f64, mean: &mut [f64], scatter: &mut [f64]) {
    let (first, second) = (&first[..d], &second[..d * d]);
    let (mean, scatter) = (&mut mean[..d], &mut scatter[..d * d]);
    for i in 0..d {
        let shift = first[i] / mass;
        mean[i] += shift;
        for j in 0..=i {
            let value = (second[i * d + j] - first[j] * shift) / mass;
            // Rounding can leave a variance of duplicates a hair below zero.
            let value = if i == j { value.max(0.0) } else { value };
            scatter[i * d + j] = value;
            scatter[j * d + i] = value;
        }
    }
}

/// Shrinkage, ridge and floor, in this order.
fn regularise(params: &GmmParams, covariances: &mut [f64], d: usize, iteration: usize, floored: &mut Vec<Floored>) {
    let (lambda, ridge, floor) = (params.shrinkage, params.ridge, params.floor);
    let mut note = |component: usize, smallest: f64| match floored.iter_mut().find(|f| f.component == component) {
        Some(f) => {
            f.last_iteration = iteration;
            f.times += 1;
            f.smallest_eigenvalue = f.smallest_eigenvalue.min(smallest);
        }
        None => floored.push(Floored {
            component,
            first_iteration: iteration,
            last_iteration: iteration,
            times: 1,
            smallest_eigenvalue: smallest,
        }),
    };
    if params.covariance.is_diagonal() {
        let per = if params.covariance == CovarianceKind::Diagonal { d } else { 1 };
        for (component, variances) in covariances.chunks_exact_mut(per).enumerate() {
            let mean = variances.iter().sum::<f64>() / per as f64;
            let mut smallest = f64::INFINITY;
            for v in variances {
                *v += lambda * (mean - *v) + ridge;
                if *v < floor {
                    smallest = smallest.min(*v);
                    *v = floor;
                }
            }
            if smallest < f64::INFINITY {
                note(component, smallest);
            }
        }
    } else {
        for (component, matrix) in covariances.chunks_exact_mut(d * d).enumerate() {
            let mean = (0..d).map(|i| matrix[i * d + i]).sum::<f64>() / d as f64;
            if lambda > 0.0 {
                matrix.iter_mut().for_each(|v| *v *= 1.0 - lambda);
            }
            for i in 0..d {
                matrix[i * d + i] += lambda * mean + ridge;
            }
            // A scatter matrix has no negative eigenvalue, so a ridge of that size is above the floor already.
            if floor > ridge
                && let Some(smallest) = clip_eigenvalues(matrix, d, floor)
            {
                note(component, smallest);
            }
        }
    }
}
