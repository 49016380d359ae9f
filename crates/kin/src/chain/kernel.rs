//! Forward kinematics and the Jacobian in one pass over the joints, without allocation.
//!
//! The loops are compiled for several instruction sets and dispatched once per call. They hold no fused
//! multiply-add, so every instruction set gives the same bits.

use nalgebra::{Isometry3, IsometryMatrix3, Matrix6xX};
use pulp::{Simd, WithSimd};

use super::{Chain, Frame, MAX_STAGES, Stage, cross, sincos};

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
        if let (Some(stages), Some(q)) = (self.turning::<6>(), q.as_array()) {
            return walk_turns(stages, &self.end, q, |_, _| ());
        }
        if let (Some(stages), Some(q)) = (self.turning::<7>(), q.as_array()) {
            return walk_turns(stages, &self.end, q, |_, _| ());
        }
        self.walk(q, |_, _| ())
    }

    /// The body of [`Chain::tip_frame_and_jacobian`], for callers that are dispatched already.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(crate) fn tip_frame_and_jacobian_here(&self, q: &[f64], columns: &mut [f64]) -> Frame {
        if let (Some(stages), Some(q), Some(columns)) =
            (self.turning::<6>(), q.as_array(), columns.as_chunks_mut::<6>().0.as_mut_array())
        {
            return turning_columns(stages, &self.end, q, columns);
        }
        if let (Some(stages), Some(q), Some(columns)) =
            (self.turning::<7>(), q.as_array(), columns.as_chunks_mut::<6>().0.as_mut_array())
        {
            return turning_columns(stages, &self.end, q, columns);
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

    /// The stages of a chain of exactly `N` turning joints, one joint value each.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a test of two words")]
    fn turning<const N: usize>(&self) -> Option<&[Stage; N]> {
        if self.plain_turns { self.stages.as_array() } else { None }
    }

    /// Pose of the tip, and the Jacobian by rows of `L` joints, for callers that are dispatched already. Joints of `q`
    /// beyond the chain's have zeros.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(crate) fn tip_frame_and_rows_here<const D: usize, const L: usize>(
        &self,
        q: &[f64; D],
    ) -> (Frame, [[f64; L]; 6]) {
        let mut rows = [[0.0; L]; 6];
        if D <= sincos::BLOCK
            && let Some(stages) = self.turning::<D>()
        {
            let (mut axes, mut origins) = ([[0.0; L]; 3], [[0.0; L]; 3]);
            let tip = walk_turns(stages, &self.end, q, |index, frame| {
                for r in 0..3 {
                    axes[r][index] = frame.z[r];
                    origins[r][index] = frame.p[r];
                }
            });
            for j in 0..L {
                let [x, y, z] = [tip.p[0] - origins[0][j], tip.p[1] - origins[1][j], tip.p[2] - origins[2][j]];
                rows[0][j] = axes[1][j] * z - axes[2][j] * y;
                rows[1][j] = axes[2][j] * x - axes[0][j] * z;
                rows[2][j] = axes[0][j] * y - axes[1][j] * x;
                for r in 0..3 {
                    rows[3 + r][j] = axes[r][j];
                }
            }
            return (tip, rows);
        }
        let dof = self.dof();
        let mut columns = [[0.0; 6]; D];
        let tip = self.tip_frame_and_jacobian_here(&q[..dof], columns[..dof].as_flattened_mut());
        for (j, column) in columns.iter().enumerate() {
            for r in 0..6 {
                rows[r][j] = column[r];
            }
        }
        (tip, rows)
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

/// [`Chain::walk`] over turning joints alone, whose number the compiler knows.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn walk_turns<const N: usize>(
    stages: &[Stage; N],
    end: &Frame,
    q: &[f64; N],
    mut visit: impl FnMut(usize, &Frame),
) -> Frame {
    let mut values = [0.0; sincos::BLOCK];
    values[..N].copy_from_slice(q);
    let (sines, cosines) = sincos::sin_cos(&values);
    let mut frame = Frame::IDENTITY;
    for i in 0..N {
        let mut moved = stages[i].fixed;
        moved.turn(sines[i], cosines[i]);
        frame = if i == 0 { moved } else { frame.compose(&moved) };
        visit(i, &frame);
    }
    frame.compose(end)
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn turning_columns<const N: usize>(
    stages: &[Stage; N],
    end: &Frame,
    q: &[f64; N],
    columns: &mut [[f64; 6]; N],
) -> Frame {
    let mut axes = [[[0.0; 4]; 2]; N];
    let tip = walk_turns(stages, end, q, |index, frame| axes[index] = [frame.z, frame.p]);
    for (column, [axis, origin]) in columns.iter_mut().zip(&axes) {
        column[..3].copy_from_slice(&cross(axis, &arm(&tip.p, origin))[..3]);
        column[3..].copy_from_slice(&axis[..3]);
    }
    tip
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
        self.chain.tip_frame_here(self.q)
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
