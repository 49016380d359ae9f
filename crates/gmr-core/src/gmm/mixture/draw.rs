//! Samples drawn from a mixture, and its components in another order.

use rand::Rng;

use super::{Mixture, MixtureParts, check_dimensions};
use crate::error::{Result, check_len};
use crate::gmm::CovarianceKind;
use crate::linalg::cholesky;

impl Mixture {
    /// Draws `n` samples, `(n, d)` row-major, and the component each came from, `(n)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// use rand::SeedableRng;
    /// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    /// let (values, components) = pair.sample(20_000, &mut rng);
    /// let mean = values.iter().sum::<f64>() / 20_000.0;
    /// let share = components.iter().filter(|c| **c == 0).count() as f64 / 20_000.0;
    /// assert!(mean.abs() < 0.05 && (share - 0.5).abs() < 0.02);
    /// # Ok(())
    /// # }
    /// ```
    pub fn sample(&self, n: usize, rng: &mut impl Rng) -> (Vec<f64>, Vec<usize>) {
        let (k, d) = (self.components(), self.dim());
        let factors: Vec<Vec<f64>> = (0..k)
            .map(|c| {
                let mut factor = self.covariance(c);
                // Construction has factored the same matrix, so the Cholesky succeeds.
                let ok = cholesky(&mut factor, d).is_ok();
                debug_assert!(ok, "stored covariances are positive definite");
                factor
            })
            .collect();
        let mut values = Vec::with_capacity(n * d);
        let mut labels = Vec::with_capacity(n);
        let mut z = vec![0.0; d];
        for _ in 0..n {
            let mut u: f64 = rng.random();
            let mut c = 0;
            while c + 1 < k && u >= self.parts.weights[c] {
                u -= self.parts.weights[c];
                c += 1;
            }
            for v in &mut z {
                *v = standard_normal(rng);
            }
            let (mean, factor) = (self.mean(c), &factors[c]);
            values.extend((0..d).map(|i| mean[i] + (0..=i).map(|j| factor[i * d + j] * z[j]).sum::<f64>()));
            labels.push(c);
        }
        (values, labels)
    }

    /// The same mixture with its components in the given order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// assert_eq!(pair.reordered(&[1, 0])?.means(), [1.0, -1.0]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// `order` is not a permutation of the components.
    pub fn reordered(&self, order: &[usize]) -> Result<Self> {
        let (k, d) = (self.components(), self.dim());
        check_len("component order", k, order.len())?;
        check_dimensions("component order", order, k)?;
        let p = &self.parts;
        let gather = |v: &[f64], stride: usize| -> Vec<f64> {
            order.iter().flat_map(|&c| v[c * stride..(c + 1) * stride].iter().copied()).collect()
        };
        let covariances = match p.kind {
            CovarianceKind::Full => gather(&p.covariances, d * d),
            CovarianceKind::Tied => p.covariances.clone(),
            CovarianceKind::Diagonal => gather(&p.covariances, d),
            CovarianceKind::Spherical => gather(&p.covariances, 1),
        };
        Self::new(MixtureParts {
            kind: p.kind,
            dim: d,
            weights: gather(&p.weights, 1),
            means: gather(&p.means, d),
            covariances,
        })
    }
}

/// One standard normal number by the polar method of Marsaglia.
pub(crate) fn standard_normal(rng: &mut impl Rng) -> f64 {
    loop {
        let u = rng.random::<f64>().mul_add(2.0, -1.0);
        let v = rng.random::<f64>().mul_add(2.0, -1.0);
        let s = u * u + v * v;
        if s > 0.0 && s < 1.0 {
            return u * (-2.0 * s.ln() / s).sqrt();
        }
    }
}
