//! What a run did, in numbers: for a person and as JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;

/// Everything the summary holds. Keys and units are stable; scripts read them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Frames that went through the pose network.
    pub frames: u64,
    /// Frames that were captured and overtaken by a newer one.
    pub dropped: u64,
    /// Arm samples with all three joints.
    pub complete_samples: u64,
    /// Time per stage, milliseconds.
    pub latency_ms: BTreeMap<String, Spread>,
    /// How the robot followed, over the time it was following.
    pub tracking: Option<Tracking>,
    /// Comparison with `--reference`.
    pub reference: Reference,
    /// What was learned.
    pub learned: Option<Learned>,
    /// Stops and holds by cause.
    pub stops: BTreeMap<String, u64>,
    /// The network, its runtime and its execution provider.
    pub pose: String,
    /// The recording.
    pub recording: Option<PathBuf>,
}

/// Median and 99th percentile.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// Errors of the robot against the worker's arm as it was seen, at the same capture time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tracking {
    /// Time the robot was following, seconds.
    pub following_s: f64,
    /// Root mean square over all joints and times.
    pub joint_rms_rad: f64,
    /// Largest of any joint at any time.
    pub joint_max_rad: f64,
    /// Largest within the first two seconds of following.
    pub joint_max_first_2s_rad: f64,
    /// Root mean square after the first two seconds; null where there are none.
    pub joint_settled_rms_rad: Option<f64>,
    /// Root mean square of the tool against the retargeted wrist, millimetres, axes of `world`.
    pub wrist_rmse_mm: Axes,
    /// The same, squared: mm^2.
    pub wrist_mse_mm2: Axes,
}

/// One number per axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Axes {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
}

/// Comparison of the recovered wrist with a reference made by other means.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reference {
    /// Median distance, millimetres; null without a reference.
    pub wrist_median_mm: Option<f64>,
    /// 90th percentile of the distance.
    pub wrist_p90_mm: Option<f64>,
    /// Samples compared.
    pub samples: u64,
}

/// What was learned.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Learned {
    /// Repetitions of the action in the lesson.
    pub demonstrations: usize,
    /// Motion elements of 1000 ms.
    pub elements: usize,
    /// Duration of the action, seconds.
    pub duration_s: f64,
    /// Whether its end joins its beginning.
    pub cyclic: bool,
    /// Metres of tool per metre of wrist.
    pub scale: f64,
    /// Share of following samples that the model explained.
    pub matched_share: Option<f64>,
    /// Time the learning took, milliseconds.
    pub learn_ms: f64,
}

/// Times of one stage as a histogram whose cells grow by [`GROWTH`]: a run of months needs no more memory than one of
/// seconds, and a quantile is exact to half a percent.
#[derive(Debug, Clone)]
struct Histogram {
    cells: Vec<u64>,
    count: u64,
}

/// Upper end of a cell over its lower end.
const GROWTH: f64 = 1.01;
/// Upper end of the first cell, milliseconds: nothing that is measured takes less than 100 ns.
const SMALLEST_MS: f64 = 1e-4;
/// Enough cells to reach 100 s.
const CELLS: usize = 2083;

impl Histogram {
    fn new() -> Self {
        Self { cells: vec![0; CELLS], count: 0 }
    }

    fn add(&mut self, ms: f64) {
        let cell = ((ms / SMALLEST_MS).ln() / GROWTH.ln()).ceil().clamp(0.0, (CELLS - 1) as f64);
        self.cells[cell as usize] += 1;
        self.count += 1;
    }

    fn quantile(&self, q: f64) -> f64 {
        let rank = ((q * self.count as f64).ceil() as u64).clamp(1, self.count);
        let mut seen = 0;
        let cell = self.cells.iter().position(|n| {
            seen += n;
            seen >= rank
        });
        SMALLEST_MS * GROWTH.powf(cell.unwrap_or(CELLS - 1) as f64 - 0.5)
    }
}

/// Times per stage.
#[derive(Debug, Clone, Default)]
pub struct Latencies(BTreeMap<&'static str, Histogram>);

impl Latencies {
    /// Adds one measured time.
    pub fn add(&mut self, stage: &'static str, time: Duration) {
        self.0.entry(stage).or_insert_with(Histogram::new).add(time.as_secs_f64() * 1e3);
    }

    /// Joins the times of another thread.
    pub fn merge(&mut self, other: &Self) {
        for (stage, theirs) in &other.0 {
            let ours = self.0.entry(stage).or_insert_with(Histogram::new);
            ours.count += theirs.count;
            for (a, b) in ours.cells.iter_mut().zip(&theirs.cells) {
                *a += b;
            }
        }
    }

    /// Median and 99th percentile per stage.
    pub fn spread(&self) -> BTreeMap<String, Spread> {
        let spread = |h: &Histogram| Spread { p50: h.quantile(0.5), p99: h.quantile(0.99) };
        self.0.iter().filter(|(_, h)| h.count > 0).map(|(stage, h)| ((*stage).to_owned(), spread(h))).collect()
    }
}

/// The value below which the share `q` lies (nearest rank).
///
/// # Panics
/// On an empty slice.
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = ((q * sorted.len() as f64).ceil() as usize).clamp(1, sorted.len());
    sorted[rank - 1]
}

/// One comparison of the robot with the worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Time since following began, seconds.
    pub since_s: f64,
    /// Measured minus wanted, per joint.
    pub joint_error_rad: Vec<f64>,
    /// Measured minus wanted tool position in `world`.
    pub tool_error_m: [f64; 3],
}

/// Sums over the comparisons of a run.
#[derive(Debug, Clone, Default)]
pub struct TrackingSums {
    count: u64,
    following_s: f64,
    squares: f64,
    angles: u64,
    settled_squares: f64,
    settled_angles: u64,
    worst_rad: f64,
    worst_first_2s_rad: f64,
    tool_squares_mm2: [f64; 3],
}

impl TrackingSums {
    /// Adds one comparison.
    pub fn add(&mut self, comparison: &Comparison) {
        self.count += 1;
        self.following_s = self.following_s.max(comparison.since_s);
        for e in &comparison.joint_error_rad {
            self.squares += e * e;
            self.angles += 1;
            self.worst_rad = self.worst_rad.max(e.abs());
            if comparison.since_s <= 2.0 {
                self.worst_first_2s_rad = self.worst_first_2s_rad.max(e.abs());
            } else {
                self.settled_squares += e * e;
                self.settled_angles += 1;
            }
        }
        for (sum, e) in self.tool_squares_mm2.iter_mut().zip(comparison.tool_error_m) {
            *sum += (e * 1e3).powi(2);
        }
    }

    /// The figures; `None` where nothing was compared.
    pub fn figures(&self) -> Option<Tracking> {
        (self.count > 0).then(|| {
            let [x, y, z] = self.tool_squares_mm2.map(|sum| sum / self.count as f64);
            let root = |sum: f64, count: u64| (sum / count as f64).sqrt();
            Tracking {
                following_s: self.following_s,
                joint_rms_rad: root(self.squares, self.angles),
                joint_max_rad: self.worst_rad,
                joint_max_first_2s_rad: self.worst_first_2s_rad,
                joint_settled_rms_rad: (self.settled_angles > 0)
                    .then(|| root(self.settled_squares, self.settled_angles)),
                wrist_rmse_mm: Axes { x: x.sqrt(), y: y.sqrt(), z: z.sqrt() },
                wrist_mse_mm2: Axes { x, y, z },
            }
        })
    }
}

impl Reference {
    /// Distances between positions of equal index, metres.
    pub fn of(distances_m: &[f64]) -> Self {
        let mm: Vec<f64> = distances_m.iter().map(|d| d * 1e3).collect();
        let some = |q| (!mm.is_empty()).then(|| quantile(&mm, q));
        Self { wrist_median_mm: some(0.5), wrist_p90_mm: some(0.9), samples: mm.len() as u64 }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "frames      {} seen, {} dropped, {} with the whole arm",
            self.frames, self.dropped, self.complete_samples
        )?;
        writeln!(f, "pose        {}", self.pose)?;
        for (stage, s) in &self.latency_ms {
            writeln!(f, "  {stage:<10}{:>9.2} ms median {:>9.2} ms p99", s.p50, s.p99)?;
        }
        if let Some(l) = &self.learned {
            let kind = if l.cyclic { "repeating" } else { "one-time" };
            writeln!(
                f,
                "learned     {kind} action of {:.2} s from {} demonstration(s): {} motion elements, in {:.0} ms",
                l.duration_s, l.demonstrations, l.elements, l.learn_ms
            )?;
            let matched = l.matched_share.map_or(String::new(), |share| {
                format!(", the model explained {:.0} % of what followed", share * 100.0)
            });
            writeln!(f, "            {:.2} m of tool per m of wrist{matched}", l.scale)?;
        }
        match &self.tracking {
            None => writeln!(f, "tracking    the robot did not get to follow")?,
            Some(t) => {
                writeln!(
                    f,
                    "tracking    {:.1} s; measured joints against the worker at the same instant",
                    t.following_s
                )?;
                let settled = t.joint_settled_rms_rad.map_or("-".to_owned(), |v| format!("{v:.4}"));
                writeln!(
                    f,
                    "  joints    rms {:.4} rad, max {:.4} rad (first 2 s {:.4}), settled rms {settled} rad",
                    t.joint_rms_rad, t.joint_max_rad, t.joint_max_first_2s_rad
                )?;
                let (r, m) = (&t.wrist_rmse_mm, &t.wrist_mse_mm2);
                writeln!(
                    f,
                    "  wrist     rmse x {:.2} y {:.2} z {:.2} mm (mse {:.2} {:.2} {:.2} mm²)",
                    r.x, r.y, r.z, m.x, m.y, m.z
                )?;
            }
        }
        if let (Some(median), Some(p90)) = (self.reference.wrist_median_mm, self.reference.wrist_p90_mm) {
            writeln!(
                f,
                "reference   wrist within {median:.1} mm (median), {p90:.1} mm (p90) over {} samples",
                self.reference.samples
            )?;
        }
        if !self.stops.is_empty() {
            let list: Vec<String> = self.stops.iter().map(|(cause, n)| format!("{cause} x{n}")).collect();
            writeln!(f, "stops       {}", list.join(", "))?;
        }
        match &self.recording {
            Some(path) => write!(f, "recording   {}", path.display()),
            None => write!(f, "recording   none"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_rank() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        for (q, expected) in [(0.0, 1.0), (0.5, 3.0), (0.9, 5.0), (1.0, 5.0)] {
            assert!((quantile(&values, q) - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn tracking_is_what_a_hand_computes() {
        let at =
            |since_s, e: f64| Comparison { since_s, joint_error_rad: vec![e, -e], tool_error_m: [e / 10.0, 0.0, 0.0] };
        let mut sums = TrackingSums::default();
        assert!(sums.figures().is_none());
        sums.add(&at(0.0, 0.4));
        sums.add(&at(3.0, 0.3));
        let t = sums.figures().unwrap();
        assert!((t.joint_rms_rad - (0.125_f64).sqrt()).abs() < 1e-15);
        assert_eq!((t.joint_max_rad, t.joint_max_first_2s_rad), (0.4, 0.4));
        assert!((t.joint_settled_rms_rad.unwrap() - 0.3).abs() < 1e-15);
        assert!((t.wrist_mse_mm2.x - 1250.0).abs() < 1e-9 && t.wrist_mse_mm2.y.abs() < 1e-15);
    }

    #[test]
    fn histogram_quantiles_are_those_of_the_sorted_values_to_half_a_percent() {
        let values: Vec<f64> = (1..=1000).map(|i| 0.003 * f64::from(i).powf(1.3)).collect();
        let mut latencies = Latencies::default();
        for ms in &values {
            latencies.add("stage", Duration::try_from_secs_f64(ms / 1e3).unwrap());
        }
        let spread = latencies.spread()["stage"];
        for (got, q) in [(spread.p50, 0.5), (spread.p99, 0.99)] {
            assert!((got / quantile(&values, q) - 1.0).abs() < 0.006, "{got}");
        }
    }

    #[test]
    fn a_run_without_reference_says_null() {
        let json = serde_json::to_value(Reference::of(&[])).unwrap();
        assert!(json["wrist_median_mm"].is_null());
    }
}
