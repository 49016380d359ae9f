//! The time derivative of the Jacobian.
//!
//! With `z_i`, `o_i` the axis and origin of joint `i`, `w_i` and `v_i` the angular velocity after it and the velocity of
//! its origin, and `p` the tip: `d z_i / dt = w_i x z_i`, so that a turning joint's column changes by
//! `[(w_i x z_i) x (p - o_i) + z_i x (dp/dt - v_i); w_i x z_i]` and a sliding one's by `[w_i x z_i; 0]`.

use nalgebra::{Matrix6xX, Vector3};

use super::{Chain, MAX_STAGES};

impl Chain {
    /// `dJ/dt` at `q` with joint speeds `qd`, rows as in the Jacobian; the tip then accelerates by `J qdd + dJ/dt qd`.
    /// No allocation. `rates` is `6 x dof`.
    ///
    /// # Panics
    /// When a length does not fit [`Chain::dof`].
    ///
    /// ```
    /// use kin::Robot;
    /// use nalgebra::Matrix6xX;
    /// let chain = Robot::builtin().chain("base_link", "tool0")?;
    /// let (q, qd) = ([0.1, 1.0, -1.5, 0.3, 0.2, 0.1], [0.5, -0.2, 0.4, 0.1, -0.6, 0.3]);
    /// let mut rates = Matrix6xX::zeros(6);
    /// chain.jacobian_rate_into(&q, &qd, &mut rates);
    /// let h = 1e-6;
    /// let shifted: Vec<f64> = q.iter().zip(&qd).map(|(q, qd)| q + h * qd).collect();
    /// let numeric = (chain.jacobian(&shifted) - chain.jacobian(&q)) / h;
    /// assert!((numeric - rates).norm() < 1e-5);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn jacobian_rate_into(&self, q: &[f64], qd: &[f64], rates: &mut Matrix6xX<f64>) {
        self.assert_length(q);
        self.assert_length(qd);
        assert_eq!(rates.ncols(), self.dof(), "Jacobian rate of chain {} -> {}", self.base(), self.tip());
        let mut axes = [[Vector3::zeros(); 2]; MAX_STAGES];
        let vector = |c: &[f64; 4]| Vector3::new(c[0], c[1], c[2]);
        let tip = vector(&self.walk(q, |index, frame| axes[index] = [vector(&frame.z), vector(&frame.p)]).p);
        // First pass: velocities of every joint origin, and at last of the tip.
        let mut motions = [[Vector3::zeros(); 2]; MAX_STAGES];
        let (mut omega, mut velocity, mut at) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        for (index, stage) in self.stages.iter().enumerate() {
            let [axis, origin] = axes[index];
            let speed = stage.multiplier * qd[stage.dof];
            velocity += omega.cross(&(origin - at));
            if stage.turns {
                omega += axis * speed;
            } else {
                velocity += axis * speed;
            }
            at = origin;
            motions[index] = [omega, velocity];
        }
        velocity += omega.cross(&(tip - at));
        rates.fill(0.0);
        for (index, stage) in self.stages.iter().enumerate() {
            let ([axis, origin], [omega, own]) = (axes[index], motions[index]);
            let axis_rate = omega.cross(&axis);
            let mut column = rates.column_mut(stage.dof);
            let linear =
                if stage.turns { axis_rate.cross(&(tip - origin)) + axis.cross(&(velocity - own)) } else { axis_rate };
            for i in 0..3 {
                column[i] += stage.multiplier * linear[i];
                if stage.turns {
                    column[3 + i] += stage.multiplier * axis_rate[i];
                }
            }
        }
    }
}
