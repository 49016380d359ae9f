//! The general filter: missing values, unknown start of the integrated levels, state at the end.
//!
//! State `(a, l)`: the ARMA state `a: (r)` and the levels `l: (d)` with
//! `y_t = l_1 + .. + l_d + mu + a_1` and `l_i' = l_i + .. + l_d + mu + a_1`. The unknown start of the
//! levels and `mu` enter as regressors, filtered beside the data (de Jong 1991): their innovations `E`
//! give `beta = (sum E E'/F)^-1 sum E v/F`. The diffuse log-likelihood takes `ln det` of the block of
//! the levels only, because `mu` is estimated by maximum likelihood and not integrated out.

use super::filter::{Arma, Work};
use crate::error::{Error, Result};
use crate::linalg::{cholesky, solve_lower, solve_lower_transpose};

/// Sums and final state of the general filter, per unit innovation variance.
#[derive(Debug, Clone)]
pub(super) struct Filtered {
    /// Observed values.
    pub(super) observed: usize,
    /// `sum ln F + ln det S_dd`.
    pub(super) log_f: f64,
    /// `sum v v / F` at the best `beta`.
    pub(super) squares: f64,
    /// The given or estimated `mu`.
    pub(super) mean: f64,
    /// Final predicted state `(r + d)` with `beta` put in.
    pub(super) state: Vec<f64>,
    /// Its covariance `(r + d, r + d)`.
    pub(super) covariance: Vec<f64>,
    /// One-step prediction errors given only the values before: index, error, variance. Present once
    /// those values determine the levels, and only when the mean is known.
    pub(super) innovations: Vec<(usize, f64, f64)>,
}

/// Either a known mean or one to estimate.
#[derive(Debug, Clone, Copy)]
pub(super) enum Mean {
    Known(f64),
    Estimated,
}

/// `T x` for the joint state.
pub(super) fn advance(arma: &Arma, d: usize, x: &[f64], intercept: f64, out: &mut [f64]) {
    let r = arma.r;
    for i in 0..r {
        out[i] = arma.phi[i] * x[0] + if i + 1 < r { x[i + 1] } else { 0.0 };
    }
    let mut sum = x[0] + intercept;
    for i in (0..d).rev() {
        sum += x[r + i];
        out[r + i] = sum;
    }
}

/// `Z x`.
pub(super) fn observe(arma: &Arma, x: &[f64]) -> f64 {
    x[0] + x[arma.r..].iter().sum::<f64>()
}

/// One step of the covariance: update with an observation if there is one, then prediction.
/// Returns the gain `K = T P Z' / F` and `F` (zero gain for a missing value).
pub(super) fn step_covariance(arma: &Arma, d: usize, p: &mut Vec<f64>, observed: bool) -> (Vec<f64>, f64) {
    let s = arma.r + d;
    let pz: Vec<f64> = p.chunks_exact(s).map(|row| observe(arma, row)).collect();
    let f = observe(arma, &pz);
    let mut tpz = vec![0.0; s];
    advance(arma, d, &pz, 0.0, &mut tpz);
    let gain: Vec<f64> = tpz.iter().map(|v| if observed { v / f } else { 0.0 }).collect();
    // T P T' row by row: first the columns of P', then the rows.
    let mut half = vec![0.0; s * s];
    let mut row = vec![0.0; s];
    for i in 0..s {
        advance(arma, d, &p[i * s..(i + 1) * s], 0.0, &mut row);
        for j in 0..s {
            half[j * s + i] = row[j];
        }
    }
    let mut next = vec![0.0; s * s];
    for i in 0..s {
        advance(arma, d, &half[i * s..(i + 1) * s], 0.0, &mut next[i * s..(i + 1) * s]);
    }
    for i in 0..s {
        for j in 0..s {
            let noise = if i < arma.r && j < arma.r { arma.theta[i] * arma.theta[j] } else { 0.0 };
            next[i * s + j] += noise - gain[i] * tpz[j];
        }
    }
    for i in 0..s {
        for j in 0..i {
            let mean = 0.5 * (next[i * s + j] + next[j * s + i]);
            next[i * s + j] = mean;
            next[j * s + i] = mean;
        }
    }
    *p = next;
    (gain, f)
}

/// Filters `y`, NaN marking missing values.
pub(super) fn filter(arma: &Arma, d: usize, y: &[f64], mean: Mean) -> Result<Filtered> {
    let (r, s) = (arma.r, arma.r + d);
    let estimated = matches!(mean, Mean::Estimated);
    let known = if let Mean::Known(m) = mean { m } else { 0.0 };
    let columns = d + usize::from(estimated);
    let mut work = Work::new(r);
    arma.stationary_covariance(&mut work);
    let mut p = vec![0.0; s * s];
    for i in 0..r {
        p[i * s..i * s + r].copy_from_slice(&work.p[i * r..(i + 1) * r]);
    }
    // Column 0 carries the data, then one per level, then mu.
    let mut x = vec![vec![0.0; s]; 1 + columns];
    for i in 0..d {
        x[1 + i][r + i] = 1.0;
    }
    let intercept = |c: usize| {
        if c == 0 {
            known
        } else if c == d + 1 {
            1.0
        } else {
            0.0
        }
    };
    let mut gram = vec![0.0; columns * columns];
    let mut cross = vec![0.0; columns];
    let (mut log_f, mut squares, mut observed) = (0.0, 0.0, 0);
    let mut innovations = Vec::with_capacity(y.len());
    let mut next = vec![0.0; s];
    for (t, &value) in y.iter().enumerate() {
        let seen = !value.is_nan();
        let (gain, f) = step_covariance(arma, d, &mut p, seen);
        check_variance(t, f)?;
        let expected: Vec<f64> = (0..=columns).map(|c| observe(arma, &x[c]) + intercept(c)).collect();
        let v = value - expected[0];
        for (c, x) in x.iter_mut().enumerate() {
            advance(arma, d, x, intercept(c), &mut next);
            if seen {
                let innovation = if c == 0 { v } else { -expected[c] };
                for (n, k) in next.iter_mut().zip(&gain) {
                    *n += k * innovation;
                }
            }
            x.copy_from_slice(&next);
        }
        if seen {
            if !estimated && let Some((correction, spread)) = level_correction(&gram, &cross, &expected[1..]) {
                innovations.push((t, v - correction, f + spread));
            }
            observed += 1;
            log_f += f.ln();
            squares += v * v / f;
            for i in 0..columns {
                cross[i] += expected[1 + i] * v / f;
                for j in 0..columns {
                    gram[i * columns + j] += expected[1 + i] * expected[1 + j] / f;
                }
            }
        }
    }
    let mut beta = cross.clone();
    let mut factor = gram;
    if columns > 0 {
        // The levels come first, so the leading block of the factor is the factor of their block.
        if observed < columns {
            return Err(Error::TooFewSamples { what: "ARIMA levels and mean", needed: columns, got: observed });
        }
        cholesky(&mut factor, columns).map_err(|p| Error::NotPositiveDefinite {
            what: "information about the ARIMA levels and mean",
            index: 0,
            pivot: p.row,
            value: p.value,
        })?;
        solve_lower(&factor, columns, &mut beta);
        squares -= beta.iter().map(|b| b * b).sum::<f64>();
        solve_lower_transpose(&factor, columns, &mut beta);
        log_f += 2.0 * (0..d).map(|i| factor[i * columns + i].ln()).sum::<f64>();
    }
    let state: Vec<f64> =
        (0..s).map(|i| x[0][i] + beta.iter().zip(&x[1..]).map(|(b, x)| b * x[i]).sum::<f64>()).collect();
    // What is left unknown of the levels: X S^-1 X' over their block.
    for i in 0..s {
        let mut a: Vec<f64> = (0..d).map(|c| x[1 + c][i]).collect();
        solve_leading(&factor, columns, d, &mut a);
        for j in 0..s {
            let mut b: Vec<f64> = (0..d).map(|c| x[1 + c][j]).collect();
            solve_leading(&factor, columns, d, &mut b);
            p[i * s + j] += a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    check_variance(y.len(), observe(arma, &p.chunks_exact(s).map(|row| observe(arma, row)).collect::<Vec<f64>>()))?;
    if let Some(i) = state.iter().position(|v| !v.is_finite()) {
        return Err(lost(i, state[i]));
    }
    Ok(Filtered {
        observed,
        log_f,
        squares: squares.max(0.0),
        mean: if estimated { beta[d] } else { known },
        state,
        covariance: p,
        innovations,
    })
}

/// No prediction is surer than the innovation, whose variance is the unit here. A variance well below it, or none,
/// means that a unit root has swallowed all digits.
fn check_variance(t: usize, f: f64) -> Result<()> {
    if f > 0.5 && f < f64::INFINITY { Ok(()) } else { Err(lost(t, f)) }
}

fn lost(t: usize, value: f64) -> Error {
    Error::NotPositiveDefinite {
        what: "prediction variance of an ARIMA model on a unit root, value",
        index: t,
        pivot: 0,
        value,
    }
}

/// What the levels, estimated from the values so far, add to a prediction: `E beta` and `E S^-1 E'`. `None`
/// until they are determined.
fn level_correction(gram: &[f64], cross: &[f64], e: &[f64]) -> Option<(f64, f64)> {
    let d = e.len();
    let mut factor = gram.to_vec();
    cholesky(&mut factor, d).ok()?;
    let (mut beta, mut half) = (cross.to_vec(), e.to_vec());
    solve_lower(&factor, d, &mut beta);
    solve_lower(&factor, d, &mut half);
    let correction = beta.iter().zip(&half).map(|(b, h)| b * h).sum();
    Some((correction, half.iter().map(|h| h * h).sum()))
}

/// Forward substitution with the leading `d` rows of a factor of row length `columns`.
fn solve_leading(factor: &[f64], columns: usize, d: usize, b: &mut [f64]) {
    for i in 0..d {
        let sum: f64 = (0..i).map(|k| factor[i * columns + k] * b[k]).sum();
        b[i] = (b[i] - sum) / factor[i * columns + i];
    }
}
