//! What a mixture consists of.

use super::{Mixture, MixtureParts};
use crate::gmm::CovarianceKind;

impl Mixture {
    /// Number of components `k`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.components(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn components(&self) -> usize {
        self.parts.weights.len()
    }

    /// Dimension `d`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.dim(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn dim(&self) -> usize {
        self.parts.dim
    }

    /// Shape of the covariances.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.covariance_kind(), CovarianceKind::Diagonal);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance_kind(&self) -> CovarianceKind {
        self.parts.kind
    }

    /// Weights `pi: (k)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.weights(), [0.25, 0.75]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn weights(&self) -> &[f64] {
        &self.parts.weights
    }

    /// Means `mu: (k, d)`, row-major.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.means(), [0.0, 1.0, 2.0, 3.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn means(&self) -> &[f64] {
        &self.parts.means
    }

    /// Mean of one component, `(d)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.mean(1), [2.0, 3.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn mean(&self, component: usize) -> &[f64] {
        let d = self.dim();
        &self.parts.means[component * d..(component + 1) * d]
    }

    /// Stored covariances: full `(k, d, d)`, tied `(d, d)`, diagonal `(k, d)`, spherical `(k)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.covariances(), [4.0, 9.0, 1.0, 1.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariances(&self) -> &[f64] {
        &self.parts.covariances
    }

    /// Covariance of one component as a full matrix, `(d, d)`.
    ///
    /// ```
    /// use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let parts = MixtureParts {
    ///     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![4.0, 9.0],
    /// };
    /// assert_eq!(Mixture::new(parts)?.covariance(0), [4.0, 0.0, 0.0, 9.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance(&self, component: usize) -> Vec<f64> {
        let d = self.dim();
        let stored = &self.parts.covariances;
        let mut out = vec![0.0; d * d];
        match self.parts.kind {
            CovarianceKind::Full => out.copy_from_slice(&stored[component * d * d..(component + 1) * d * d]),
            CovarianceKind::Tied => out.copy_from_slice(stored),
            CovarianceKind::Diagonal => (0..d).for_each(|j| out[j * d + j] = stored[component * d + j]),
            CovarianceKind::Spherical => (0..d).for_each(|j| out[j * d + j] = stored[component]),
        }
        out
    }

    /// The numbers, for storage.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.parts().weights, [0.25, 0.75]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn parts(&self) -> &MixtureParts {
        &self.parts
    }
}
