//! Smooth scalar functions of time: steps, pulses and seeded noise.
//!
//! Steps and pulses have three continuous derivatives, the noise four, so that whatever is composed of them has a
//! continuous jerk. Noise is a quintic B-spline over hashed lattice values: it can be asked at any time in any order.

#[cfg(test)]
mod tests;

/// Maps `(seed, stream, index)` to a number in `[-1, 1)`; splitmix64 finaliser (Steele, Lea and Flood, 2014).
pub(crate) fn hash_unit(seed: u64, stream: u64, index: i64) -> f64 {
    let mut z = seed
        .wrapping_add(stream.wrapping_mul(0x9E37_79B9_7F4A_7C15))
        .wrapping_add((index as u64).wrapping_mul(0xD1B5_4A32_D192_ED03));
    for _ in 0..2 {
        z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
    }
    (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Band-limited noise in `[-1, 1]` with four continuous derivatives and one lattice value per unit of `x`.
pub(crate) fn noise(seed: u64, stream: u64, x: f64) -> f64 {
    let cell = x.floor();
    let f = x - cell;
    let (f2, f3) = (f * f, f * f * f);
    let (f4, f5) = (f2 * f2, f2 * f3);
    let g = 1.0 - f;
    let weights = [
        g * g * g * g * g,
        26.0 - 50.0 * f + 20.0 * f2 + 20.0 * f3 - 20.0 * f4 + 5.0 * f5,
        66.0 - 60.0 * f2 + 30.0 * f4 - 10.0 * f5,
        26.0 + 50.0 * f + 20.0 * f2 - 20.0 * f3 - 20.0 * f4 + 10.0 * f5,
        1.0 + 5.0 * f + 10.0 * f2 + 10.0 * f3 + 5.0 * f4 - 5.0 * f5,
        f5,
    ];
    weights.iter().zip(-2_i64..).map(|(w, k)| w / 120.0 * hash_unit(seed, stream, cell as i64 + k)).sum()
}

/// Rises from 0 at `start` to 1 at `end`; the septic step, whose first three derivatives vanish at both ends.
pub(crate) fn step(start: f64, end: f64, x: f64) -> f64 {
    let s = ((x - start) / (end - start)).clamp(0.0, 1.0);
    let s4 = s * s * s * s;
    s4 * (35.0 - 84.0 * s + 70.0 * s * s - 20.0 * s * s * s)
}

/// Rises from 0 at `start` to 1 in the middle and falls back to 0 at `end`: `(4 s (1 - s))^4`.
pub(crate) fn pulse(start: f64, end: f64, x: f64) -> f64 {
    let s = ((x - start) / (end - start)).clamp(0.0, 1.0);
    let b = 4.0 * s * (1.0 - s);
    b * b * b * b
}

/// Identity up to `knee`, then bends so that it never reaches `limit`; twice continuously differentiable
/// because `tanh` has zero curvature at the knee.
pub(crate) fn soft_limit(x: f64, knee: f64, limit: f64) -> f64 {
    if x <= knee {
        x
    } else {
        let room = limit - knee;
        knee + room * ((x - knee) / room).tanh()
    }
}
