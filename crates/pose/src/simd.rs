//! The best instruction set of the machine.
//!
//! Kernels are plain loops; compiling them a second time for AVX2 makes them twice as fast on x86-64. Nothing is fused, so
//! both versions give the same bits.

use pulp::{Scalar, WithSimd};

#[derive(Debug, Clone, Copy)]
pub(crate) struct Machine {
    #[cfg(target_arch = "x86_64")]
    avx2: Option<pulp::x86::V3>,
}

impl Machine {
    pub(crate) fn detect() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            avx2: pulp::x86::V3::try_new(),
        }
    }

    pub(crate) fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return pulp::Simd::vectorize(avx2, op);
        }
        op.with_simd(Scalar)
    }
}
