//! What the worker does: known motions of one joint, and a recorded one.

use std::f64::consts::TAU;

/// A motion of one joint.
pub(crate) struct Signal {
    pub(crate) name: &'static str,
    kind: Kind,
    pub(crate) duration_s: f64,
    /// Start of the stretch that lag and error are taken over.
    pub(crate) settled_s: f64,
    /// Lag has no meaning for a step.
    pub(crate) moving: bool,
    /// Overshoot has a meaning.
    pub(crate) ends_at_rest: bool,
}

enum Kind {
    Step,
    Ramp,
    Sine { hertz: f64, amplitude: f64 },
    Chirp,
    Recorded { rate_hz: f64, samples: Vec<f64> },
}

impl Signal {
    pub(crate) fn synthetic() -> Vec<Self> {
        let sine = |name, hertz, amplitude| Self {
            name,
            kind: Kind::Sine { hertz, amplitude },
            duration_s: 10.0,
            settled_s: 2.0,
            moving: true,
            ends_at_rest: false,
        };
        vec![
            Self {
                name: "step 0.5 rad",
                kind: Kind::Step,
                duration_s: 3.0,
                settled_s: 0.0,
                moving: false,
                ends_at_rest: true,
            },
            Self {
                name: "ramp 0.8 rad/s, then stop",
                kind: Kind::Ramp,
                duration_s: 4.0,
                settled_s: 0.0,
                moving: true,
                ends_at_rest: true,
            },
            sine("sine 0.5 Hz", 0.5, 0.4),
            sine("sine 1 Hz", 1.0, 0.2),
            sine("sine 2 Hz", 2.0, 0.05),
            sine("sine 3 Hz", 3.0, 0.0225),
            sine("sine 2 Hz, 79 % of limit", 2.0, 0.1),
            Self {
                name: "chirp 0.2-3 Hz",
                kind: Kind::Chirp,
                duration_s: 10.0,
                settled_s: 1.0,
                moving: true,
                ends_at_rest: false,
            },
        ]
    }

    /// One coordinate of a recorded wrist relative to its shoulder, 1 m of it read as 1.5 rad.
    /// `table` is a CSV text with a header and columns `rsho_*`, `rwri_*` at 60 Hz.
    pub(crate) fn recorded(table: &str) -> Option<Self> {
        const RATE_HZ: f64 = 60.0;
        const RADIANS_PER_METRE: f64 = 1.5;
        let mut lines = table.lines();
        let names: Vec<&str> = lines.next()?.split(',').collect();
        let column = |name: &str| names.iter().position(|n| *n == name);
        let axes = [("rsho_x", "rwri_x"), ("rsho_y", "rwri_y"), ("rsho_z", "rwri_z")];
        let rows: Vec<Vec<f64>> =
            lines.map(|line| line.split(',').map(|c| c.parse().unwrap_or(f64::NAN)).collect()).collect();
        // The axis that the wrist moves along most.
        let samples = axes
            .iter()
            .filter_map(|(shoulder, wrist)| Some((column(shoulder)?, column(wrist)?)))
            .map(|(s, w)| rows.iter().map(|r| RADIANS_PER_METRE * (r[w] - r[s])).collect::<Vec<f64>>())
            .filter(|samples| samples.iter().all(|x| x.is_finite()))
            .max_by(|a, b| spread(a).total_cmp(&spread(b)))?;
        let duration_s = (samples.len() - 1) as f64 / RATE_HZ;
        Some(Self {
            name: "recorded wrist",
            kind: Kind::Recorded { rate_hz: RATE_HZ, samples },
            duration_s,
            settled_s: 0.3,
            moving: true,
            ends_at_rest: false,
        })
    }

    pub(crate) fn position(&self, t: f64) -> f64 {
        match &self.kind {
            Kind::Step => {
                if t >= 0.2 {
                    0.5
                } else {
                    0.0
                }
            }
            Kind::Ramp => 0.8 * (t - 0.2).clamp(0.0, 2.0),
            Kind::Sine { hertz, amplitude } => amplitude * (TAU * hertz * t).sin(),
            Kind::Chirp => 0.0225 * (TAU * t * (0.2 + 0.14 * t)).sin(),
            Kind::Recorded { rate_hz, samples } => {
                // Catmull-Rom through the recorded points.
                let last = samples.len() - 1;
                let at = (t * rate_hz).clamp(0.0, last as f64);
                let k = (at as usize).min(last - 1);
                let u = at - k as f64;
                let get = |i: usize| samples[i.min(last)];
                let (a, b, c, d) = (get(k.saturating_sub(1)), get(k), get(k + 1), get(k + 2));
                let (m0, m1) = ((c - a) / 2.0, (d - b) / 2.0);
                let (square, cube) = (3.0 * (c - b) - 2.0 * m0 - m1, m0 + m1 - 2.0 * (c - b));
                b + u * (m0 + u * (square + u * cube))
            }
        }
    }

    /// Velocity as a worker tracker would know it: exact for formulas, the backward difference
    /// of the last two recorded points for the recording.
    pub(crate) fn velocity(&self, t: f64) -> f64 {
        if matches!(self.kind, Kind::Step) {
            return 0.0;
        }
        let h = if matches!(self.kind, Kind::Recorded { .. }) { 1.0 / 60.0 } else { 1e-6 };
        (self.position(t) - self.position(t - h)) / h
    }
}

fn spread(samples: &[f64]) -> f64 {
    let fold = |f: fn(f64, f64) -> f64| samples.iter().copied().reduce(f).unwrap_or(0.0);
    fold(f64::max) - fold(f64::min)
}
