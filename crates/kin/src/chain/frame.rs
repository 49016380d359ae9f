//! A rigid transform as four padded columns: the working type of the kernels.

use nalgebra::{Isometry3, IsometryMatrix3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A vector padded to four, so that the compiler keeps it in whole vector registers.
pub(crate) type Column = [f64; 4];

/// Rotation columns `x`, `y`, `z` and translation `p`.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Frame {
    pub(crate) x: Column,
    pub(crate) y: Column,
    pub(crate) z: Column,
    pub(crate) p: Column,
}

impl Frame {
    pub(crate) const IDENTITY: Self =
        Self { x: [1.0, 0.0, 0.0, 0.0], y: [0.0, 1.0, 0.0, 0.0], z: [0.0, 0.0, 1.0, 0.0], p: [0.0; 4] };

    pub(crate) fn new(rotation: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        let column = |i: usize| [rotation[(0, i)], rotation[(1, i)], rotation[(2, i)], 0.0];
        Self { x: column(0), y: column(1), z: column(2), p: [p.x, p.y, p.z, 0.0] }
    }

    pub(crate) fn from_isometry(isometry: &Isometry3<f64>) -> Self {
        Self::new(isometry.rotation.to_rotation_matrix().matrix(), &isometry.translation.vector)
    }

    pub(crate) fn rotation(&self) -> Matrix3<f64> {
        let column = |c: &Column| Vector3::new(c[0], c[1], c[2]);
        Matrix3::from_columns(&[column(&self.x), column(&self.y), column(&self.z)])
    }

    pub(crate) fn position(&self) -> Vector3<f64> {
        Vector3::new(self.p[0], self.p[1], self.p[2])
    }

    pub(crate) fn to_isometry_matrix(self) -> IsometryMatrix3<f64> {
        IsometryMatrix3::from_parts(
            Translation3::from(self.position()),
            Rotation3::from_matrix_unchecked(self.rotation()),
        )
    }

    pub(crate) fn to_isometry(self) -> Isometry3<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation());
        Isometry3::from_parts(Translation3::from(self.position()), UnitQuaternion::from_rotation_matrix(&rotation))
    }

    /// `self * other`.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "the kernels are measured with it; a call per joint costs a tenth")]
    pub(crate) fn compose(&self, other: &Self) -> Self {
        let mut result = Self { x: [0.0; 4], y: [0.0; 4], z: [0.0; 4], p: [0.0; 4] };
        for i in 0..4 {
            result.x[i] = self.x[i] * other.x[0] + self.y[i] * other.x[1] + self.z[i] * other.x[2];
            result.y[i] = self.x[i] * other.y[0] + self.y[i] * other.y[1] + self.z[i] * other.y[2];
            result.z[i] = self.x[i] * other.z[0] + self.y[i] * other.z[1] + self.z[i] * other.z[2];
            result.p[i] = self.p[i] + self.x[i] * other.p[0] + self.y[i] * other.p[1] + self.z[i] * other.p[2];
        }
        result
    }

    /// Turns about the frame's own z.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "the kernels are measured with it; a call per joint costs a tenth")]
    pub(crate) fn turn(&mut self, sine: f64, cosine: f64) {
        for i in 0..4 {
            let (x, y) = (self.x[i], self.y[i]);
            self.x[i] = cosine * x + sine * y;
            self.y[i] = cosine * y - sine * x;
        }
    }

    /// Slides along the frame's own z.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "the kernels are measured with it; a call per joint costs a tenth")]
    pub(crate) fn slide(&mut self, travel: f64) {
        for i in 0..4 {
            self.p[i] += travel * self.z[i];
        }
    }
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
pub(crate) fn cross(a: &Column, b: &Column) -> Column {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0], 0.0]
}
