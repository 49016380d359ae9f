//! The likelihood of a series as a function of unconstrained numbers.

use super::dense::{self, Mean};
use super::filter::{self, Arma, Sums};
use super::lanes::{self, Models};
use super::model::differenced;
use super::polynomial::{invertible, stationary};
use crate::error::{Error, Result};
use crate::wide::LANES;

/// A series prepared for the search: scaled to about one, differenced when complete.
pub(super) struct Prepared {
    /// Complete and differenced, or as given with NaN.
    pub(super) values: Vec<f64>,
    pub(super) complete: bool,
    d: usize,
    constant: bool,
    /// Power of two that was divided out.
    pub(super) scale: f64,
    /// Subtracted from a complete differenced series when a mean is estimated.
    pub(super) centre: f64,
    /// Observed minus `d`.
    pub(super) n: usize,
}

/// Likelihood ingredients at one set of coefficients.
pub(super) struct Evaluation {
    pub(super) log_f: f64,
    pub(super) squares: f64,
    pub(super) mean: f64,
}

impl Prepared {
    pub(super) fn new(y: &[f64], d: usize, constant: bool) -> Result<Self> {
        let observed = y.iter().filter(|v| !v.is_nan()).count();
        let n = observed.saturating_sub(d);
        let complete = observed == y.len();
        let mut values = if complete { differenced(y, d) } else { y.to_vec() };
        let centre = if complete && constant { values.iter().sum::<f64>() / values.len().max(1) as f64 } else { 0.0 };
        values.iter_mut().for_each(|v| *v -= centre);
        let peak = values.iter().filter(|v| !v.is_nan()).fold(0.0f64, |m, v| m.max(v.abs()));
        if !(peak >= 1e-290) {
            return Err(Error::Degenerate { what: "series after differencing and removing the mean" });
        }
        let scale = peak.log2().floor().exp2();
        values.iter_mut().for_each(|v| *v /= scale);
        Ok(Self { values, complete, d, constant, scale, centre, n })
    }

    fn of_sums(&self, sums: &Sums) -> Evaluation {
        let squares = sums.squares(self.constant);
        Evaluation { log_f: sums.log_f, squares, mean: sums.mean(self.constant) }
    }

    /// Exact likelihood of one model.
    pub(super) fn evaluate(&self, arma: &Arma, work: &mut filter::Work) -> Option<Evaluation> {
        if self.complete {
            Some(self.of_sums(&filter::filter(arma, &self.values, self.constant, false, work)))
        } else {
            let mean = if self.constant { Mean::Estimated } else { Mean::Known(0.0) };
            let filtered = dense::filter(arma, self.d, &self.values, mean).ok()?;
            Some(Evaluation { log_f: filtered.log_f, squares: filtered.squares, mean: filtered.mean })
        }
    }
}

/// Minus the log-likelihood per value, the variance concentrated out and constants left off, as a function of
/// unconstrained numbers.
pub(super) struct Objective<'a> {
    prepared: &'a Prepared,
    p: usize,
    ar: Vec<f64>,
    ma: Vec<f64>,
    /// Models side by side, for complete series.
    models: Models,
    models_work: lanes::Work,
    /// One model, for series with gaps.
    arma: Arma,
    work: filter::Work,
}

impl<'a> Objective<'a> {
    pub(super) fn new(prepared: &'a Prepared, p: usize, q: usize) -> Self {
        let (ar, ma) = (vec![0.0; p], vec![0.0; q]);
        let (models, arma) = (Models::new(p, q), Arma::new(&ar, &ma));
        Self {
            prepared,
            p,
            models_work: lanes::Work::new(&models),
            models,
            work: filter::Work::new(arma.r),
            arma,
            ar,
            ma,
        }
    }

    /// How many points cost as much as one.
    pub(super) fn at_once(&self) -> usize {
        if self.prepared.complete { LANES } else { 1 }
    }

    /// The value at each of `points: (m, p + q)`; infinite where there is none.
    ///
    /// `conditional` asks for the conditional sum of squares, which takes a complete series.
    pub(super) fn values(&mut self, points: &[f64], conditional: bool, values: &mut [f64]) {
        let numbers = self.p + self.ma.len();
        for (batch, values) in values.chunks_mut(LANES).enumerate() {
            let point = |i: usize| &points[(batch * LANES + i) * numbers..][..numbers];
            if self.prepared.complete {
                for lane in 0..LANES {
                    // Lanes to spare repeat the first point.
                    self.place(point(if lane < values.len() { lane } else { 0 }));
                    self.models.set(lane, &self.ar, &self.ma);
                }
                let Prepared { values: w, constant, .. } = self.prepared;
                let sums = lanes::filter(&self.models, w, *constant, conditional, &mut self.models_work);
                for (value, sums) in values.iter_mut().zip(&sums) {
                    *value = self.value(Some(self.prepared.of_sums(sums)));
                }
            } else {
                for (i, value) in values.iter_mut().enumerate() {
                    self.place(point(i));
                    self.arma.set(&self.ar, &self.ma);
                    let found = self.prepared.evaluate(&self.arma, &mut self.work);
                    *value = self.value(found);
                }
            }
        }
    }

    /// The value at a point as the filter of one model computes it, which is the one that is reported. Beside a unit root its digits
    /// may run out where those of models side by side did not.
    pub(super) fn exact(&mut self, x: &[f64]) -> f64 {
        self.place(x);
        self.arma.set(&self.ar, &self.ma);
        let found = self.prepared.evaluate(&self.arma, &mut self.work);
        self.value(found)
    }

    /// The coefficients of a point, and the exact likelihood there.
    pub(super) fn at(mut self, x: &[f64]) -> (Option<Evaluation>, Vec<f64>, Vec<f64>) {
        self.place(x);
        self.arma.set(&self.ar, &self.ma);
        (self.prepared.evaluate(&self.arma, &mut self.work), self.ar, self.ma)
    }

    fn place(&mut self, x: &[f64]) {
        stationary(&x[..self.p], &mut self.ar);
        invertible(&x[self.p..], &mut self.ma);
    }

    fn value(&self, found: Option<Evaluation>) -> f64 {
        let n = self.prepared.n as f64;
        let value = match found {
            Some(e) if e.squares > 0.0 => 0.5 * ((e.squares / n).ln() + e.log_f / n),
            _ => f64::INFINITY,
        };
        if value.is_nan() { f64::INFINITY } else { value }
    }
}
