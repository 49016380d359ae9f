//! Forward kinematics and the Jacobian in one pass over the joints, without allocation.
//!
//! The loops are compiled for several instruction sets and dispatched once per call. They hold no fused
//! multiply-add, so every instruction set gives the same bits.

use nalgebra::{Isometry3, IsometryMatrix3, Matrix6xX};
use pulp::{Simd, WithSimd};

use super::{Chain, Frame, MAX_STAGES, cross, sincos};

impl Chain {
    /// Pose of the tip in the base.
    ///
    /// # Panics
    /// When `q` does not have [`Chain::dof`] values.
    pub fn fk(&self, q: &[f64]) -> Isometry3<f64> {
        self.tip_frame(q).to_isometry()
    }

    /// Pose of the tip in the base, with the rotation as a matrix: saves the conversion to a quaternion.
    ///
    /// # Panics
    /// When `q` does not have [`Chain::dof`] values.
    pub fn fk_matrix(&self, q: &[f64]) -> IsometryMatrix3<f64> {
        self.tip_frame(q).to_isometry_matrix()
    }

    /// Jacobian at the tip (see the module documentation for rows), `6 x dof`.
    ///
    /// # Panics
    /// When `q` does not have [`Chain::dof`] values.
    pub fn jacobian(&self, q: &[f64]) -> Matrix6xX<f64> {
        let mut jacobian = Matrix6xX::zeros(self.dof());
        self.fk_jacobian_into(q, &mut jacobian);
        jacobian
    }

    /// Pose and Jacobian together, without allocation. `jacobian` is `6 x dof`.
    ///
    /// # Panics
    /// When `q` or `jacobian` does not fit [`Chain::dof`].
    pub fn fk_jacobian_into(&self, q: &[f64], jacobian: &mut Matrix6xX<f64>) -> IsometryMatrix3<f64> {
        self.tip_frame_and_jacobian(q, jacobian.as_mut_slice()).to_isometry_matrix()
    }

    /// As [`Chain::fk_jacobian_into`], with the Jacobian as one column of six after another.
    pub(crate) fn tip_frame_and_jacobian(&self, q: &[f64], columns: &mut [f64]) -> Frame {
        self.assert_length(q);
        assert_eq!(columns.len(), 6 * self.dof(), "Jacobian of chain {} -> {}", self.base, self.tip);
        self.machine.run(PoseAndJacobian { chain: self, q, columns })
    }

    pub(crate) fn tip_frame(&self, q: &[f64]) -> Frame {
        self.assert_length(q);
        self.machine.run(Pose { chain: self, q })
    }

    /// The body of [`Chain::tip_frame`], for callers that are dispatched already.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(crate) fn tip_frame_here(&self, q: &[f64]) -> Frame {
        self.walk(q, |_, _| ())
    }

    /// The body of [`Chain::tip_frame_and_jacobian`], for callers that are dispatched already.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(crate) fn tip_frame_and_jacobian_here(&self, q: &[f64], columns: &mut [f64]) -> Frame {
        if self.plain_turns {
            let tip = self.walk(q, |index, frame| {
                let column = &mut columns[6 * index..6 * index + 6];
                column[..3].copy_from_slice(&frame.p[..3]);
                column[3..].copy_from_slice(&frame.z[..3]);
            });
            for column in columns.as_chunks_mut::<6>().0 {
                let origin = [column[0], column[1], column[2], 0.0];
                let axis = [column[3], column[4], column[5], 0.0];
                column[..3].copy_from_slice(&cross(&axis, &arm(&tip.p, &origin))[..3]);
            }
            return tip;
        }
        columns.fill(0.0);
        let mut axes = [[[0.0; 4]; 2]; MAX_STAGES];
        let tip = self.walk(q, |index, frame| axes[index] = [frame.z, frame.p]);
        for (stage, [axis, origin]) in self.stages.iter().zip(&axes) {
            let column = &mut columns[6 * stage.dof..6 * stage.dof + 6];
            let linear = if stage.turns { cross(axis, &arm(&tip.p, origin)) } else { *axis };
            for i in 0..3 {
                column[i] += stage.multiplier * linear[i];
                if stage.turns {
                    column[3 + i] += stage.multiplier * axis[i];
                }
            }
        }
        tip
    }

    /// Visits the frame after each stage (z is its axis) from base to tip and returns the tip.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "the visitor must melt into the loop")]
    pub(crate) fn walk(&self, q: &[f64], mut visit: impl FnMut(usize, &Frame)) -> Frame {
        let mut frame = Frame::IDENTITY;
        for (block, stages) in self.stages.chunks(sincos::BLOCK).enumerate() {
            let mut values = [0.0; sincos::BLOCK];
            for (value, stage) in values.iter_mut().zip(stages) {
                *value = if self.plain { q[stage.dof] } else { stage.multiplier * q[stage.dof] + stage.offset };
            }
            let (sines, cosines) = sincos::sin_cos(&values);
            // All local motions first: they do not wait for one another, as the products below do.
            let mut moved = [Frame::IDENTITY; sincos::BLOCK];
            for (i, (moved, stage)) in moved.iter_mut().zip(stages).enumerate() {
                *moved = stage.fixed;
                if stage.turns {
                    moved.turn(sines[i], cosines[i]);
                } else {
                    moved.slide(values[i]);
                }
            }
            for (i, moved) in moved[..stages.len()].iter().enumerate() {
                frame = frame.compose(moved);
                visit(block * sincos::BLOCK + i, &frame);
            }
        }
        frame.compose(&self.end)
    }
}

struct Pose<'a> {
    chain: &'a Chain,
    q: &'a [f64],
}

impl WithSimd for Pose<'_> {
    type Output = Frame;

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set it is dispatched to")]
    fn with_simd<S: Simd>(self, _: S) -> Frame {
        self.chain.walk(self.q, |_, _| ())
    }
}

struct PoseAndJacobian<'a> {
    chain: &'a Chain,
    q: &'a [f64],
    columns: &'a mut [f64],
}

impl WithSimd for PoseAndJacobian<'_> {
    type Output = Frame;

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set it is dispatched to")]
    fn with_simd<S: Simd>(self, _: S) -> Frame {
        self.chain.tip_frame_and_jacobian_here(self.q, self.columns)
    }
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn arm(tip: &[f64; 4], origin: &[f64; 4]) -> [f64; 4] {
    [tip[0] - origin[0], tip[1] - origin[1], tip[2] - origin[2], 0.0]
}
