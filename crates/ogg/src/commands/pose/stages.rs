//! How long each stage takes.

use std::fmt;
use std::time::{Duration, Instant};

use pose::{Estimator, ImageView, Person, Stage};
use serde::Serialize;

use crate::error::Error;

/// Times of many pictures by stage, and of each picture as a whole.
#[derive(Debug, Default)]
pub(super) struct Stages {
    times_ms: [Vec<f64>; 4],
}

/// Times of one stage.
#[derive(Debug, Clone, Serialize)]
pub(super) struct StageTimes {
    stage: &'static str,
    pictures: usize,
    p50_ms: f64,
    p99_ms: f64,
    /// Pictures per second at the median.
    per_second: f64,
}

impl Stages {
    /// Estimates one picture by the clock.
    pub(super) fn estimate(&mut self, estimator: &mut Estimator, image: ImageView<'_>) -> Result<Vec<Person>, Error> {
        let start = Instant::now();
        let (mut last, mut spent) = (start, [Duration::ZERO; 3]);
        let people = estimator.estimate_observed(image, &mut |stage| {
            let now = Instant::now();
            spent[stage as usize] += now - last;
            last = now;
        })?;
        let whole = start.elapsed();
        for (times, time) in self.times_ms.iter_mut().zip(spent.into_iter().chain([whole])) {
            times.push(time.as_secs_f64() * 1e3);
        }
        Ok(people)
    }

    pub(super) fn summary(&self) -> Vec<StageTimes> {
        let names = Stage::ALL.map(Stage::name).into_iter().chain(["whole picture"]);
        names
            .zip(&self.times_ms)
            .filter(|(_, times)| !times.is_empty())
            .map(|(stage, times)| {
                let mut sorted = times.clone();
                sorted.sort_by(f64::total_cmp);
                let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
                StageTimes {
                    stage,
                    pictures: sorted.len(),
                    p50_ms: at(0.5),
                    p99_ms: at(0.99),
                    per_second: 1e3 / at(0.5).max(1e-6),
                }
            })
            .collect()
    }
}

impl fmt::Display for StageTimes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stage, pictures, p50_ms, p99_ms, per_second } = self;
        write!(f, "{stage:14} {p50_ms:9.3} {p99_ms:9.3} {per_second:10.1} {pictures:9}")
    }
}
