//! A table of joint vectors spread evenly over the limits, with the poses they lead to: where a search begins when the seed
//! leads nowhere.

use nalgebra::{Matrix3, Vector3};

use super::problem::Problem;
use crate::Chain;

/// Poses in the table.
const COUNT: usize = 1024;
/// Poses compared at once.
const LANES: usize = 8;
const BLOCKS: usize = COUNT / LANES;

/// The table of a chain.
#[derive(Debug, Default)]
pub(crate) struct Starts {
    /// Joint vectors, one after another.
    q: Vec<f64>,
    /// Position (m), rotation by columns, position squared (m^2); as precise as a first guess needs.
    poses: Vec<[[f32; LANES]; 13]>,
}

/// How far each pose of a table is from a target: half of `|p - p'|^2 + rho^2 |R - R'|^2 / 2`, but for a constant. The second
/// term is `4 (1 - cos t) / 2`, about the square of the angle.
pub(super) struct Near {
    costs: [[f32; LANES]; BLOCKS],
}

impl Starts {
    pub(crate) fn of(chain: &Chain) -> Self {
        let dof = chain.dof();
        let ranges: Vec<(f64, f64)> = chain.limits().iter().map(crate::JointLimits::finite_range).collect();
        let strides = golden_strides(dof);
        let mut q = Vec::with_capacity(COUNT * dof);
        let mut poses = vec![[[0.0; LANES]; 13]; BLOCKS];
        for index in 0..COUNT {
            let begin = q.len();
            q.extend(
                ranges
                    .iter()
                    .zip(&strides)
                    .map(|((lower, upper), stride)| lower + (upper - lower) * (0.5 + stride * index as f64).fract()),
            );
            let tip = chain.tip_frame(&q[begin..]);
            let features = features(&tip.position(), &tip.rotation());
            for (lanes, feature) in poses[index / LANES].iter_mut().zip(features) {
                lanes[index % LANES] = feature as f32;
            }
        }
        Self { q, poses }
    }

    /// Compares the whole table with a target.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(super) fn near(&self, problem: &Problem) -> Near {
        let rotation = problem.target_rotation * (0.5 * problem.rho * problem.rho);
        let target = features(&problem.target_position, &rotation);
        let mut factors = [0.0f32; 13];
        for (factor, feature) in factors.iter_mut().zip(&target[..12]) {
            *factor = -*feature as f32;
        }
        factors[12] = 0.5;
        let mut costs = [[0.0f32; LANES]; BLOCKS];
        for (costs, pose) in costs.iter_mut().zip(&self.poses) {
            for f in 0..13 {
                for lane in 0..LANES {
                    costs[lane] += factors[f] * pose[f][lane];
                }
            }
        }
        Near { costs }
    }

    /// The nearest joint vector not taken yet.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(super) fn take(&self, near: &mut Near, q: &mut [f64]) {
        let mut least = [f32::INFINITY; LANES];
        let mut at = [0u32; LANES];
        for (block, costs) in (0u32..).zip(&near.costs) {
            for lane in 0..LANES {
                let less = costs[lane] < least[lane];
                least[lane] = if less { costs[lane] } else { least[lane] };
                at[lane] = if less { block } else { at[lane] };
            }
        }
        let mut lane = 0;
        for other in 1..LANES {
            if least[other] < least[lane] {
                lane = other;
            }
        }
        let block = at[lane] as usize;
        near.costs[block][lane] = f32::INFINITY;
        let begin = (block * LANES + lane) * q.len();
        q.copy_from_slice(&self.q[begin..begin + q.len()]);
    }
}

/// The entries whose products sum to `p . p' + R : R'`, and the square of `p`.
fn features(p: &Vector3<f64>, rotation: &Matrix3<f64>) -> [f64; 13] {
    let mut features = [0.0; 13];
    features[..3].copy_from_slice(p.as_slice());
    features[3..12].copy_from_slice(rotation.as_slice());
    features[12] = p.norm_squared();
    features
}

/// Multiples of these fill the unit cube evenly: powers of the root of `x^(n + 1) = x + 1` (Roberts 2018).
fn golden_strides(dimensions: usize) -> Vec<f64> {
    let power = 1.0 / (dimensions as f64 + 1.0);
    let mut root = 2.0f64;
    for _ in 0..60 {
        root = (1.0 + root).powf(power);
    }
    (1..=dimensions).map(|i| root.powi(-(i as i32))).collect()
}
