//! From a stream of arm samples to demonstrations: uniformly sampled repetitions of one action.
//!
//! Complete samples become postures (see [`Posture`]); gaps up to `longest_gap_s` are bridged by straight lines; a longer
//! gap ends the piece, and the longest piece is used. The track is resampled at `rate_hz` and smoothed by a Gaussian of
//! `smoothing_s` (zero phase: teaching is not real time). Where the motion repeats itself (see [`crate::find_period`]) it is
//! cut at equal phase and every repetition is stretched to the median duration; otherwise the whole piece is one
//! demonstration. The [`TeachReport`] says what was used, bridged and dropped.

use crate::error::Error;
use crate::period::find_period;
use crate::posture::{DIMENSION, Posture};
use crate::sample::ArmSample;

/// How far a repetition reaches into the next one, seconds.
const SEAM_S: f64 = 0.2;

/// Settings of the teaching stage.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeachParams {
    /// Rate of the resampled demonstrations, Hz.
    pub rate_hz: f64,
    /// Longest gap that is bridged by a straight line, seconds.
    pub longest_gap_s: f64,
    /// Standard deviation of the smoothing Gaussian, seconds. A hand at a bench moves below 3 Hz; 0.04 s leaves 3 Hz at
    /// 75 % of its amplitude and takes 97 % off at 10 Hz.
    pub smoothing_s: f64,
    /// Shortest repetition that counts as a period, seconds.
    pub shortest_period_s: f64,
    /// Autocorrelation from which on the motion counts as repeated (1 = perfectly).
    pub period_threshold: f64,
    /// Shortest usable piece, seconds.
    pub shortest_s: f64,
}

impl Default for TeachParams {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            longest_gap_s: 0.3,
            smoothing_s: 0.04,
            shortest_period_s: 1.0,
            period_threshold: 0.7,
            shortest_s: 0.5,
        }
    }
}

impl TeachParams {
    fn validate(&self) -> Result<(), Error> {
        let fields = [
            ("teach.rate_hz", self.rate_hz, 10.0, 1000.0),
            ("teach.longest_gap_s", self.longest_gap_s, 0.0, 2.0),
            ("teach.smoothing_s", self.smoothing_s, 0.0, 0.5),
            ("teach.shortest_period_s", self.shortest_period_s, 0.2, 60.0),
            ("teach.period_threshold", self.period_threshold, 0.0, 1.0),
            ("teach.shortest_s", self.shortest_s, 0.1, 60.0),
        ];
        for (name, value, low, high) in fields {
            if !(value >= low && value <= high) {
                return Err(Error::Parameter { name, value, expected: format!("in [{low}, {high}]") });
            }
        }
        Ok(())
    }
}

/// One repetition of an action, sampled at equal steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Demonstration {
    /// Time between two rows, seconds.
    pub step_s: f64,
    /// Postures, `(n, 6)`: wrist x, y, z in `world` (m) and the three arm angles (rad, unwrapped).
    pub postures: Vec<[f64; DIMENSION]>,
}

impl Demonstration {
    /// Time from the first to the last row, seconds.
    pub fn duration_s(&self) -> f64 {
        self.postures.len().saturating_sub(1) as f64 * self.step_s
    }
}

/// What teaching did with the samples it was given.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TeachReport {
    /// Samples given.
    pub samples: usize,
    /// Samples with all three joints, the wrist measured.
    pub complete: usize,
    /// Samples in the piece that was used.
    pub used: usize,
    /// Gaps longer than one median step that were bridged.
    pub bridged: usize,
    /// Repetitions found; 1 where the motion does not repeat.
    pub demonstrations: usize,
    /// Duration of one repetition, seconds.
    pub duration_s: f64,
    /// Whether the end of the action joins its beginning.
    pub cyclic: bool,
}

/// Demonstrations of one action, all of one duration.
#[derive(Debug, Clone, PartialEq)]
pub struct Lesson {
    /// The repetitions.
    pub demonstrations: Vec<Demonstration>,
    /// What was done to get them.
    pub report: TeachReport,
}

/// Cuts a stream of samples into demonstrations.
///
/// # Errors
/// [`Error::Parameter`] for settings out of range, [`Error::TimeRunsBackwards`] for unordered samples,
/// [`Error::TooLittleSeen`] where no piece is long enough.
pub fn teach(samples: &[ArmSample], params: &TeachParams) -> Result<Lesson, Error> {
    params.validate()?;
    for pair in samples.windows(2) {
        if pair[1].captured <= pair[0].captured {
            return Err(Error::TimeRunsBackwards { last: pair[0].captured, captured: pair[1].captured });
        }
    }
    let complete: Vec<(f64, Posture)> = samples
        .iter()
        .filter(|sample| sample.is_complete())
        .filter_map(|sample| Some((sample.captured.as_secs_f64(), Posture::of(sample)?)))
        .collect();
    let piece = longest_piece(&complete, params.longest_gap_s);
    let span_s = piece.last().map_or(0.0, |last| last.0 - piece[0].0);
    if piece.len() < 8 || span_s < params.shortest_s {
        return Err(Error::TooLittleSeen { usable: piece.len(), span_s, needed: 8, needed_s: params.shortest_s });
    }
    let mut steps: Vec<f64> = piece.windows(2).map(|p| p[1].0 - p[0].0).collect();
    steps.sort_by(f64::total_cmp);
    let median_step = steps[steps.len() / 2];
    let bridged = steps.iter().filter(|&&step| step > 1.5 * median_step).count();

    let step_s = 1.0 / params.rate_hz;
    let track = smooth(&resample(piece, step_s), params.smoothing_s / step_s);
    let wrist: Vec<[f64; 3]> = track.iter().map(|row| [row[0], row[1], row[2]]).collect();
    let min_lag = (params.shortest_period_s * params.rate_hz).round() as usize;
    let period = find_period(&wrist, min_lag, params.period_threshold);
    let demonstrations = match period {
        Some(period) => split(&track, period, step_s),
        None => vec![Demonstration { step_s, postures: track }],
    };
    let report = TeachReport {
        samples: samples.len(),
        complete: complete.len(),
        used: piece.len(),
        bridged,
        demonstrations: demonstrations.len(),
        duration_s: period.map_or_else(|| demonstrations[0].duration_s(), |period| period * step_s),
        cyclic: period.is_some(),
    };
    Ok(Lesson { demonstrations, report })
}

/// The longest run (in time) without a gap above `longest_gap_s`.
fn longest_piece(track: &[(f64, Posture)], longest_gap_s: f64) -> &[(f64, Posture)] {
    track
        .chunk_by(|a, b| b.0 - a.0 <= longest_gap_s)
        .max_by(|a, b| {
            let span = |piece: &[(f64, Posture)]| piece[piece.len() - 1].0 - piece[0].0;
            span(a).total_cmp(&span(b))
        })
        .unwrap_or(&[])
}

/// Linear interpolation at equal steps, from the first to the last sample; angles are unwrapped on the way.
fn resample(piece: &[(f64, Posture)], step_s: f64) -> Vec<[f64; DIMENSION]> {
    let mut rows: Vec<(f64, [f64; DIMENSION])> = Vec::with_capacity(piece.len());
    for (t, posture) in piece {
        let row = match rows.last() {
            Some((_, previous)) => posture.unwrapped_near(previous),
            None => posture.row(),
        };
        rows.push((*t, row));
    }
    let (start, end) = (rows[0].0, rows[rows.len() - 1].0);
    let count = ((end - start) / step_s).floor() as usize + 1;
    let mut right = 1;
    (0..count)
        .map(|i| {
            let t = start + i as f64 * step_s;
            while right + 1 < rows.len() && rows[right].0 < t {
                right += 1;
            }
            let ((t0, a), (t1, b)) = (&rows[right - 1], &rows[right]);
            let share = ((t - t0) / (t1 - t0)).clamp(0.0, 1.0);
            core::array::from_fn(|d| a[d] + share * (b[d] - a[d]))
        })
        .collect()
}

/// Gaussian smoothing with `sigma` in rows. At the ends the kernel is fitted by a line instead of cut off, so that a
/// steady motion stays what it is there.
fn smooth(track: &[[f64; DIMENSION]], sigma: f64) -> Vec<[f64; DIMENSION]> {
    if !(sigma > 0.0) {
        return track.to_vec();
    }
    let radius = (3.0 * sigma).ceil() as isize;
    (0..track.len() as isize)
        .map(|center| {
            let low = (center - radius).max(0);
            let high = (center + radius).min(track.len() as isize - 1);
            // Weighted straight-line fit around `center`; its value there. On a symmetric window this is the mean.
            let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
            let (mut y0, mut y1) = ([0.0; DIMENSION], [0.0; DIMENSION]);
            for i in low..=high {
                let x = (i - center) as f64;
                let w = (-0.5 * (x / sigma).powi(2)).exp();
                s0 += w;
                s1 += w * x;
                s2 += w * x * x;
                for (d, value) in track[i as usize].iter().enumerate() {
                    y0[d] += w * value;
                    y1[d] += w * x * value;
                }
            }
            let det = s0 * s2 - s1 * s1;
            core::array::from_fn(|d| if det > 0.0 { (s2 * y0[d] - s1 * y1[d]) / det } else { y0[d] / s0 })
        })
        .collect()
}

/// Cuts at equal phase. Each repetition has `round(period)` steps, and as many more as the track has of the next
/// [`SEAM_S`], so that the end of the action can be joined to its beginning.
fn split(track: &[[f64; DIMENSION]], period: f64, step_s: f64) -> Vec<Demonstration> {
    let steps = period.round();
    let stretch = period / steps;
    let seam_rows = (SEAM_S / step_s).round() as usize;
    let at = |x: f64| -> [f64; DIMENSION] {
        let i = (x.floor() as usize).min(track.len() - 2);
        let share = x - i as f64;
        core::array::from_fn(|d| track[i][d] + share * (track[i + 1][d] - track[i][d]))
    };
    let repetitions = ((track.len() - 1) as f64 / period).floor() as usize;
    (0..repetitions)
        .map(|k| {
            let from = k as f64 * period;
            let postures = (0..=steps as usize + seam_rows)
                .map(|i| from + i as f64 * stretch)
                .take_while(|&x| x <= (track.len() - 1) as f64)
                .map(at)
                .collect();
            Demonstration { step_s: step_s * stretch, postures }
        })
        .collect()
}
