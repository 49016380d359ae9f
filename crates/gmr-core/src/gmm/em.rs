//! The EM iteration.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::maximise::{maximise, recentre};
use super::mixture::{Mixture, MixtureParts};
use super::params::MissingValues;
use super::params::{GmmParams, Start};
use super::report::{FitReport, Floored, MissingReport, Regularisation, RestartOutcome, RestartReport, Stop};
use super::start;
use crate::error::{Error, Result, check_len};
use crate::fusion::{Fusion, FusionReport, FusionStep};
use crate::gaps::Gaps;
use crate::kernel::{self, Blocks, Moments, Workspace};
use crate::samples::Samples;

/// The state of one EM run.
struct Run {
    mixture: Mixture,
    stop: Stop,
    iterations: usize,
    history: Vec<f64>,
    log_likelihood: f64,
    k_means_iterations: usize,
    floored: Vec<Floored>,
    recentred: usize,
    fused: Vec<FusionStep>,
}

/// Samples in the form the statistics are taken from.
enum Data<'a> {
    Complete(Blocks),
    WithGaps(Gaps<'a>),
}

impl Data<'_> {
    fn moments(&self, mixture: &Mixture, centres: &[f64], work: &mut Workspace, out: &mut Moments) -> Result<()> {
        match self {
            Self::Complete(blocks) => kernel::moments(blocks, mixture.kernel(), centres, work, out),
            Self::WithGaps(gaps) => *out = gaps.moments(mixture, centres)?,
        }
        Ok(())
    }

    fn log_likelihood(&self, mixture: &Mixture, work: &mut Workspace) -> Result<f64> {
        match self {
            Self::Complete(blocks) => Ok(kernel::log_likelihood(blocks, mixture.kernel(), work)),
            Self::WithGaps(gaps) => gaps.moments(mixture, mixture.means()).map(|m| m.log_likelihood),
        }
    }
}

/// Everything a run shares with the others.
struct Job<'a> {
    params: &'a GmmParams,
    data: Data<'a>,
    /// The samples, with gaps filled by column means: what the start sees.
    start_samples: Samples<'a>,
    /// Blocks of the same, when they are not the data themselves.
    start_blocks: Option<Blocks>,
    total: f64,
    fusion: Option<&'a Fusion<'a>>,
}

pub(super) fn fit(
    params: &GmmParams,
    samples: &Samples<'_>,
    fusion: Option<&Fusion<'_>>,
) -> Result<(Mixture, FitReport)> {
    let (n, d, k) = (samples.len(), samples.dim(), params.components);
    if let Start::Mixture(mixture) = &params.start {
        check_len("sample dimension of the warm start", mixture.dim(), d)?;
    }
    if samples.missing() > 0 && params.missing == MissingValues::Refuse {
        let index = samples.values().iter().position(|v| v.is_nan()).unwrap_or(0);
        return Err(Error::NotFinite { what: "samples", index, value: f64::NAN });
    }
    let errors = fusion.map(Fusion::errors);
    let gaps = (samples.missing() > 0).then(|| Gaps::new(samples, errors));
    let (usable, total) = gaps
        .as_ref()
        .map_or_else(|| ((0..n).filter(|&i| samples.weight(i) > 0.0).count(), samples.total_weight()), Gaps::usable);
    if usable < k {
        return Err(Error::TooFewSamples { what: "mixture fit", needed: k, got: usable });
    }
    let missing = gaps.is_some().then(|| MissingReport {
        values: samples.missing(),
        partial_rows: (0..n)
            .filter(|&i| {
                let gone = samples.row(i).iter().filter(|v| v.is_nan()).count();
                gone > 0 && gone < d
            })
            .count(),
        unused_rows: n - usable,
    });
    let filled = gaps.as_ref().map(|_| with_column_means(samples));
    let start_samples = match &filled {
        Some(values) => {
            let start = Samples::new(values, d)?;
            match samples.weights() {
                Some(weights) => start.with_weights(weights)?,
                None => start,
            }
        }
        None => *samples,
    };
    let job = Job {
        params,
        start_blocks: gaps.as_ref().map(|_| Blocks::new(&start_samples, None)),
        data: gaps.map_or_else(|| Data::Complete(Blocks::new(samples, errors)), Data::WithGaps),
        start_samples,
        total,
        fusion,
    };
    let runs: Vec<std::result::Result<Run, Failure>> =
        (0..params.restarts).into_par_iter().map(|restart| run(&job, restart)).collect();
    let restarts: Vec<RestartReport> = runs
        .iter()
        .map(|run| match run {
            Ok(run) => RestartReport {
                outcome: RestartOutcome::Fitted(run.stop),
                iterations: run.iterations,
                log_likelihood: Some(run.log_likelihood / total),
            },
            Err((outcome, iterations)) => {
                RestartReport { outcome: *outcome, iterations: *iterations, log_likelihood: None }
            }
        })
        .collect();
    let mut best: Option<(usize, Run)> = None;
    for (index, run) in runs.into_iter().enumerate() {
        if let Ok(run) = run
            && best.as_ref().is_none_or(|(_, b)| run.log_likelihood > b.log_likelihood)
        {
            best = Some((index, run));
        }
    }
    let Some((best_restart, run)) = best else {
        return Err(Error::AllRestartsFailed { restarts });
    };
    let parameters = run.mixture.parameters();
    let report = FitReport {
        stop: run.stop,
        iterations: run.iterations,
        history: run.history,
        log_likelihood: run.log_likelihood,
        parameters,
        bic: parameters as f64 * total.ln() - 2.0 * run.log_likelihood,
        aic: 2.0 * parameters as f64 - 2.0 * run.log_likelihood,
        restarts,
        best_restart,
        k_means_iterations: run.k_means_iterations,
        regularisation: Regularisation {
            ridge: params.ridge,
            shrinkage: params.shrinkage,
            floor: params.floor,
            floored: run.floored,
        },
        recentred: run.recentred,
        missing,
        fusion: fusion.map(|f| FusionReport { reading: f.reading(), steps: run.fused }),
    };
    Ok((run.mixture, report))
}

type Failure = (RestartOutcome, usize);

fn run(job: &Job<'_>, restart: usize) -> std::result::Result<Run, Failure> {
    let Job { params, data, total, .. } = job;
    let (k, d, total) = (params.components, job.start_samples.dim(), *total);
    let blocks = match (data, &job.start_blocks) {
        (_, Some(blocks)) | (Data::Complete(blocks), None) => blocks,
        (Data::WithGaps(_), None) => unreachable!("data with gaps come with blocks for the start"),
    };
    let mut work = Workspace::new(blocks, k);
    let mut about = Moments::zero(k, d);
    let mut centres = Vec::new();
    let mut floored = Vec::new();
    let mut fused = Vec::new();
    let mut k_means_iterations = 0;
    let mut parts = MixtureParts {
        kind: params.covariance,
        dim: d,
        weights: Vec::new(),
        means: Vec::new(),
        covariances: Vec::new(),
    };
    let mut mixture = if let Start::Mixture(mixture) = &params.start {
        mixture.as_ref().clone()
    } else {
        let mut rng = ChaCha8Rng::seed_from_u64(params.seed);
        rng.set_stream(restart as u64);
        let assignment = start::assign(&params.start, blocks, &job.start_samples, k, &mut rng);
        k_means_iterations = assignment.iterations;
        let diagonal = params.covariance.is_diagonal();
        centres = assignment.centres;
        kernel::label_moments(blocks, &assignment.labels, diagonal, &centres, &mut work, &mut about);
        maximise(params, &about, &centres, None, 0, &mut floored, &mut parts).map_err(|o| (o, 0))?;
        Mixture::new(parts.clone()).map_err(|e| (collapsed(&e, 0), 0))?
    };
    let mut history = Vec::new();
    let mut previous = f64::NEG_INFINITY;
    let mut stop = Stop::IterationLimit { change: f64::INFINITY };
    let mut recentred = 0;
    for iteration in 1..=params.max_iterations {
        centres.clear();
        centres.extend_from_slice(mixture.means());
        let unsupported = |_| (RestartOutcome::NoSupport { iteration }, iteration);
        data.moments(&mixture, &centres, &mut work, &mut about).map_err(unsupported)?;
        let mean = about.log_likelihood / total;
        if !mean.is_finite() {
            return Err((RestartOutcome::NoSupport { iteration }, iteration));
        }
        if recentre(&about, &mut centres, d) {
            recentred += 1;
            data.moments(&mixture, &centres, &mut work, &mut about).map_err(unsupported)?;
        }
        history.push(mean);
        let fusion = job.fusion.map(|f| (f, &mut fused));
        maximise(params, &about, &centres, fusion, iteration, &mut floored, &mut parts).map_err(|o| (o, iteration))?;
        mixture.exchange(&mut parts).map_err(|e| (collapsed(&e, iteration), iteration))?;
        let change = mean - previous;
        previous = mean;
        if change.abs() < params.tolerance {
            stop = Stop::Converged { change };
            break;
        }
        stop = Stop::IterationLimit { change };
    }
    let iterations = history.len();
    let log_likelihood = data
        .log_likelihood(&mixture, &mut work)
        .ok()
        .filter(|l| l.is_finite())
        .ok_or((RestartOutcome::NoSupport { iteration: iterations }, iterations))?;
    Ok(Run { mixture, stop, iterations, history, log_likelihood, k_means_iterations, floored, recentred, fused })
}

/// What it means for a run that the numbers of an M step are no mixture.
fn collapsed(error: &Error, iteration: usize) -> RestartOutcome {
    match error {
        Error::NotPositiveDefinite { index, value, .. } => {
            RestartOutcome::CollapsedComponent { component: *index, iteration, pivot: *value }
        }
        _ => RestartOutcome::NoSupport { iteration },
    }
}

/// The samples with each missing value replaced by the mean of its column.
fn with_column_means(samples: &Samples<'_>) -> Vec<f64> {
    let d = samples.dim();
    let mut values = samples.values().to_vec();
    for j in 0..d {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (i, v) in samples.values().iter().skip(j).step_by(d).enumerate() {
            if !v.is_nan() {
                sum += samples.weight(i) * v;
                weight += samples.weight(i);
            }
        }
        let mean = if weight > 0.0 { sum / weight } else { 0.0 };
        for v in values.iter_mut().skip(j).step_by(d).filter(|v| v.is_nan()) {
            *v = mean;
        }
    }
    values
}
