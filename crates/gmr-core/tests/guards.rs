//! Input that makes no sense is refused, with an error that names it.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    Arima, ArimaOrder, ArimaParams, ArimaParts, AutoArimaParams, ChangePointParams, Chart, Coordinate, CoordinateKind,
    CovarianceKind, Criterion, DtwParams, ElementModel, ElementSequence, ElementSequenceParts, Error, Fusion,
    FusionReading, GmmParams, Mixture, MixtureParts, MotionElement, Regressor, RestParams, Samples, Start, Trajectory,
    align, arima_errors, dtw, kpss, segment_at_rest, segment_change_points, segment_fixed, select_components,
};

const HUGE: f64 = 1e150;

/// What an error is about: its kind and the name in it.
fn about<T>(result: Result<T, Error>) -> String {
    match result {
        Ok(_) => "ok".into(),
        Err(Error::InvalidParameter { name, .. }) => format!("parameter {name}"),
        Err(Error::Length { what, .. }) => format!("length {what}"),
        Err(Error::TooFewSamples { what, .. }) => format!("few {what}"),
        Err(Error::NotFinite { what, .. }) => format!("finite {what}"),
        Err(Error::OutOfRange { what, .. }) => format!("range {what}"),
        Err(Error::Dimension { what, .. }) => format!("dimension {what}"),
        Err(Error::NotPositiveDefinite { what, .. }) => format!("definite {what}"),
        Err(Error::WeightsNotNormalised { .. }) => "weights".into(),
        Err(Error::TimeNotIncreasing { .. }) => "time".into(),
        Err(Error::Degenerate { .. }) => "degenerate".into(),
        Err(Error::NoSupport { .. }) => "support".into(),
        Err(other) => format!("{other:?}"),
    }
}

fn line(n: usize, dim: usize) -> Trajectory {
    let times = (0..n).map(|i| i as f64 * 0.1).collect();
    Trajectory::new(times, (0..n * dim).map(|i| i as f64).collect(), dim).unwrap()
}

fn parts(kind: CovarianceKind, covariances: Vec<f64>) -> MixtureParts {
    MixtureParts { kind, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances }
}

fn full() -> MixtureParts {
    parts(CovarianceKind::Full, vec![1.0, 0.5, 0.5, 1.0])
}

fn pair() -> Mixture {
    let (weights, means) = (vec![0.5, 0.5], vec![0.0, 0.0, 1.0, 1.0]);
    Mixture::new(MixtureParts { weights, means, ..parts(CovarianceKind::Tied, vec![1.0, 0.5, 0.5, 1.0]) }).unwrap()
}

#[test]
fn samples_refuse_ragged_infinite_and_huge_tables_and_impossible_weights() {
    assert_eq!(about(Samples::new(&[1.0], 0)), "parameter dim");
    assert_eq!(about(Samples::new(&[1.0, 2.0, 3.0], 2)), "length samples (a whole number of rows)");
    assert_eq!(about(Samples::new(&[f64::INFINITY], 1)), "finite samples");
    assert_eq!(about(Samples::new(&[HUGE], 1)), "range samples");
    let samples = Samples::new(&[1.0, 2.0], 1).unwrap();
    assert_eq!(about(samples.with_weights(&[1.0])), "length sample weights");
    for bad in [-1.0, f64::NAN, f64::INFINITY, HUGE] {
        assert_eq!(about(samples.with_weights(&[1.0, bad])), "parameter sample weight");
    }
    assert_eq!(about(samples.with_weights(&[0.0, 0.0])), "parameter total sample weight");
}

#[test]
fn trajectories_refuse_lengths_values_and_times_that_do_not_fit() {
    let new = |times: &[f64], values: &[f64], dim| about(Trajectory::new(times.to_vec(), values.to_vec(), dim));
    assert_eq!(new(&[], &[], 1), "few trajectory");
    assert_eq!(new(&[0.0], &[], 0), "few trajectory");
    assert_eq!(new(&[0.0, 1.0], &[1.0], 1), "length trajectory values");
    assert_eq!(new(&[f64::NAN], &[1.0], 1), "finite trajectory times");
    assert_eq!(new(&[0.0], &[f64::NAN], 1), "finite trajectory values");
    assert_eq!(new(&[0.0], &[HUGE], 1), "range trajectory values");
    assert_eq!(new(&[1.0, 1.0], &[0.0, 0.0], 1), "time");
    for columns in [&[2][..], &[0, 0]] {
        assert_eq!(about(line(3, 2).select(columns)), "dimension trajectory columns");
    }
    assert_eq!(about(line(3, 2).select(&[])), "few trajectory");
}

#[test]
fn mixtures_refuse_numbers_that_are_no_mixture() {
    let with = |change: fn(&mut MixtureParts)| {
        let mut parts = full();
        change(&mut parts);
        about(Mixture::new(parts))
    };
    assert_eq!(with(|_| ()), "ok");
    assert_eq!(with(|p| p.weights.clear()), "parameter components and dim");
    assert_eq!(with(|p| p.dim = 0), "parameter components and dim");
    assert_eq!(with(|p| p.means.push(0.0)), "length means");
    assert_eq!(with(|p| p.covariances.push(0.0)), "length covariances");
    assert_eq!(with(|p| p.means[1] = f64::NAN), "finite means");
    assert_eq!(with(|p| p.means[1] = HUGE), "range means");
    assert_eq!(with(|p| p.covariances[1] = f64::NAN), "finite covariances");
    assert_eq!(with(|p| p.weights[0] = f64::NAN), "parameter weight");
    assert_eq!(with(|p| p.weights[0] = 1.5), "parameter weight");
    assert_eq!(with(|p| p.weights[0] = 0.9), "weights");
    assert_eq!(with(|p| p.covariances[1] = 0.4), "parameter covariance asymmetry");
    assert_eq!(with(|p| p.covariances[3] = 0.2), "definite covariance of component");
    for kind in [CovarianceKind::Diagonal, CovarianceKind::Spherical] {
        let values = if kind == CovarianceKind::Diagonal { vec![1.0, 0.0] } else { vec![0.0] };
        assert_eq!(about(Mixture::new(parts(kind, values))), "definite covariance of component");
    }
}

#[test]
fn mixtures_refuse_queries_of_another_dimension_or_with_holes() {
    let mixture = pair();
    let narrow = Samples::new(&[0.0], 1).unwrap();
    let holed = Samples::new(&[0.0, f64::NAN], 2).unwrap();
    assert_eq!(about(mixture.log_densities(&narrow)), "length sample dimension");
    assert_eq!(about(mixture.responsibilities(&narrow)), "length sample dimension");
    assert_eq!(about(mixture.log_densities(&holed)), "finite samples");
    assert_eq!(about(mixture.responsibilities(&holed)), "finite samples");
    assert_eq!(about(mixture.log_density(&[0.0, 0.0, 0.0])), "length query");
    let far = Samples::new(&[1e140, -1e140], 2).unwrap();
    let tight = parts(CovarianceKind::Spherical, vec![1e-200]);
    assert_eq!(about(Mixture::new(tight.clone()).unwrap().responsibilities(&far)), "support");
    assert_eq!(about(Mixture::new(tight).unwrap().fill(&[1e140, -1e140])), "support");
    assert_eq!(about(mixture.fill(&[0.0])), "length row");
    assert_eq!(about(mixture.reordered(&[0])), "length component order");
    assert_eq!(about(mixture.reordered(&[0, 0])), "dimension component order");
    assert_eq!(about(mixture.reordered(&[0, 2])), "dimension component order");
    for columns in [&[2][..], &[1, 1]] {
        assert_eq!(about(mixture.marginal(columns)), "dimension marginal dimensions");
    }
    assert_eq!(about(mixture.marginal(&[])), "parameter components and dim");
}

#[test]
fn fit_parameters_outside_their_intervals_are_refused_by_name() {
    let with = |change: fn(&mut GmmParams)| {
        let mut params = GmmParams { components: 2, covariance: CovarianceKind::Tied, ..GmmParams::default() };
        change(&mut params);
        about(params.validate())
    };
    assert_eq!(with(|_| ()), "ok");
    assert_eq!(with(|p| p.components = 0), "parameter components");
    assert_eq!(with(|p| p.restarts = 0), "parameter restarts");
    assert_eq!(with(|p| p.max_iterations = 0), "parameter max_iterations");
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        let params = GmmParams::default();
        assert_eq!(about(GmmParams { tolerance: bad, ..params.clone() }.validate()), "parameter tolerance");
        assert_eq!(about(GmmParams { ridge: bad, ..params.clone() }.validate()), "parameter ridge");
        assert_eq!(about(GmmParams { floor: bad, ..params.clone() }.validate()), "parameter floor");
        assert_eq!(about(GmmParams { shrinkage: bad, ..params }.validate()), "parameter shrinkage");
    }
    assert_eq!(with(|p| p.shrinkage = 1.0), "parameter shrinkage");
    let warm = |p: &mut GmmParams| p.start = Start::Mixture(Box::new(pair()));
    let mut params = GmmParams { components: 2, covariance: CovarianceKind::Tied, ..GmmParams::default() };
    warm(&mut params);
    assert_eq!(about(params.clone().validate()), "ok");
    assert_eq!(about(GmmParams { restarts: 2, ..params.clone() }.validate()), "parameter restarts");
    assert_eq!(about(GmmParams { components: 3, ..params.clone() }.validate()), "parameter components");
    let full = GmmParams { covariance: CovarianceKind::Full, ..params.clone() };
    assert_eq!(about(full.validate()), "parameter covariance");
    let values = [0.0, 1.0, 2.0];
    let samples = Samples::new(&values, 1).unwrap();
    assert_eq!(about(params.clone().validate().unwrap().fit(&samples)), "length sample dimension of the warm start");
    assert_eq!(about(select_components(&samples, &params, 1..=2, Criterion::Bic)), "parameter start");
}

#[test]
fn fits_refuse_holes_too_few_samples_and_errors_that_do_not_match() {
    let plan = GmmParams { components: 2, ..GmmParams::default() }.validate().unwrap();
    assert_eq!(about(plan.fit(&Samples::new(&[1.0], 1).unwrap())), "few mixture fit");
    assert_eq!(about(plan.fit(&Samples::new(&[1.0, f64::NAN], 1).unwrap())), "finite samples");
    let fusion = Fusion::new(&[1.0], FusionReading::Components).unwrap();
    assert_eq!(about(plan.fit_fused(&Samples::new(&[1.0, 2.0], 1).unwrap(), &fusion)), "length ARIMA errors");
    for bad in [-0.5, f64::NAN, f64::INFINITY] {
        assert_eq!(about(Fusion::new(&[bad], FusionReading::Literal)), "parameter ARIMA error");
    }
}

#[test]
fn regressions_refuse_splits_and_queries_that_do_not_fit() {
    let mixture = pair();
    assert_eq!(about(Regressor::new(&mixture, &[], &[0])), "parameter number of inputs and outputs");
    assert_eq!(about(Regressor::new(&mixture, &[0], &[])), "parameter number of inputs and outputs");
    for (inputs, outputs) in [([0], [0]), ([2], [0])] {
        assert_eq!(about(Regressor::new(&mixture, &inputs, &outputs)), "dimension regression dimensions");
    }
    let regressor = Regressor::new(&mixture, &[0], &[1]).unwrap();
    let mut out = regressor.prediction();
    for x in [&[][..], &[0.0, 1.0]] {
        assert_eq!(about(regressor.predict_into(x, &mut out)), "length query");
        assert_eq!(about(regressor.predict_mean_into(x, &mut out)), "length query");
        assert_eq!(about(regressor.predict_with_jacobian_into(x, &mut out)), "length query");
    }
    assert_eq!(about(regressor.predict_into(&[f64::NAN], &mut out)), "finite query");
    assert_eq!(about(regressor.predict_into(&[HUGE], &mut out)), "range query");
    let wide = Samples::new(&[0.0, 1.0], 2).unwrap();
    assert_eq!(about(regressor.predict_batch(&wide)), "length query dimension");
    assert_eq!(about(regressor.predict_mean_batch(&wide)), "length query dimension");
    let three = MixtureParts {
        kind: CovarianceKind::Diagonal,
        dim: 3,
        weights: vec![0.5, 0.5],
        means: vec![0.0; 6],
        covariances: vec![1.0; 6],
    };
    let other = Regressor::new(&Mixture::new(three).unwrap(), &[0], &[1, 2]).unwrap();
    assert_eq!(about(regressor.predict_into(&[0.0], &mut other.prediction())), "length prediction");
    let single = Regressor::new(&Mixture::new(full()).unwrap(), &[0], &[1]).unwrap();
    assert_eq!(about(regressor.predict_into(&[0.0], &mut single.prediction())), "length prediction components");
}

#[test]
fn matching_refuses_other_dimensions_bands_and_weights() {
    let (a, b) = (line(4, 1), line(4, 2));
    assert_eq!(about(dtw(&a, &b, &DtwParams::default())), "length demonstration dimension");
    assert_eq!(about(align(&a, &b, &DtwParams::default())), "length demonstration dimension");
    for band in [0.0, 1.5, f64::NAN] {
        assert_eq!(about(dtw(&a, &a, &DtwParams { band, ..DtwParams::default() })), "parameter band");
    }
    let weighted = |column_weights| DtwParams { column_weights, ..DtwParams::default() };
    assert_eq!(about(dtw(&a, &a, &weighted(vec![1.0, 1.0]))), "length column weights");
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(about(dtw(&a, &a, &weighted(vec![bad]))), "parameter column weight");
    }
}

#[test]
fn segmentation_refuses_thresholds_that_are_not_positive_and_motions_too_short() {
    let motion = line(9, 1);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(about(segment_fixed(&motion, bad)), "parameter period_s");
        assert_eq!(about(segment_at_rest(&motion, &RestParams { speed: bad, shortest_s: 1.0 })), "parameter speed");
        let params = RestParams { speed: 1.0, shortest_s: bad };
        assert_eq!(about(segment_at_rest(&motion, &params)), "parameter shortest_s");
        let params = ChangePointParams { sigma: bad, penalty: None, shortest: 3 };
        assert_eq!(about(segment_change_points(&motion, &params)), "parameter sigma");
        let params = ChangePointParams { sigma: 1.0, penalty: Some(bad), shortest: 3 };
        assert_eq!(about(segment_change_points(&motion, &params)), "parameter penalty");
    }
    let params = ChangePointParams { sigma: 1.0, penalty: None, shortest: 2 };
    assert_eq!(about(segment_change_points(&motion, &params)), "parameter shortest");
    let params = ChangePointParams { shortest: 10, ..params };
    assert!(about(segment_change_points(&motion, &params)).starts_with("few "));
    assert!(about(segment_fixed(&line(1, 1), 1.0)).starts_with("few "));
}

#[test]
fn charts_refuse_columns_centres_and_quaternions_that_do_not_fit() {
    let turn = Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] };
    assert_eq!(about(Chart::new(vec![])), "few chart coordinates");
    assert_eq!(about(Chart::new(vec![Coordinate::Angle { centre_rad: f64::NAN }])), "finite chart centre");
    let long = Coordinate::Rotation { centre: [1.1, 0.0, 0.0, 0.0] };
    assert_eq!(about(Chart::new(vec![long])), "parameter quaternion length");
    assert_eq!(about(Chart::fit(&[CoordinateKind::Angle], &[])), "few demonstrations");
    assert_eq!(about(Chart::fit(&[CoordinateKind::Angle], &[line(3, 2)])), "length chart columns");
    let chart = Chart::new(vec![turn]).unwrap();
    assert_eq!(about(chart.encode(&line(3, 2))), "length chart columns");
    let (q, mut flat, mut back) = ([1.0, 0.0, 0.0, 0.0], [0.0; 3], [0.0; 4]);
    assert_eq!(about(chart.encode_row(&q[..3], None, &mut flat)), "length chart columns");
    assert_eq!(about(chart.encode_row(&q, None, &mut back)), "length flat columns");
    assert_eq!(about(chart.encode_row(&q, Some(&[0.0]), &mut flat)), "length previous flat columns");
    assert_eq!(about(chart.decode_into(&q, &mut back)), "length flat columns");
    assert_eq!(about(chart.decode_into(&[0.0; 3], &mut flat)), "length chart columns");
}

#[test]
fn arima_refuses_orders_coefficients_and_series_that_do_not_fit() {
    let with = |change: fn(&mut ArimaParts)| {
        let mut parts = ArimaParts { ar: vec![0.5], difference: 0, ma: vec![0.1], mean: 0.0, variance: 1.0 };
        change(&mut parts);
        about(Arima::new(parts))
    };
    assert_eq!(with(|_| ()), "ok");
    assert_eq!(with(|p| p.ar[0] = f64::NAN), "finite autoregressive coefficients");
    assert_eq!(with(|p| p.ma[0] = f64::NAN), "finite moving average coefficients");
    assert_eq!(with(|p| p.mean = f64::NAN), "finite mean");
    assert_eq!(with(|p| p.variance = 0.0), "parameter variance");
    assert_eq!(with(|p| p.variance = f64::NAN), "parameter variance");
    assert_eq!(with(|p| p.ar = vec![0.0; 24]), "parameter order");
    assert_eq!(with(|p| p.difference = 5), "parameter order");
    assert_eq!(with(|p| p.ar[0] = 1.0), "parameter autoregression");
    let order = |p, d, q| ArimaParams { order: ArimaOrder { p, d, q }, constant: false, ..ArimaParams::default() };
    for (p, d, q) in [(24, 0, 0), (0, 0, 23), (0, 5, 0)] {
        assert_eq!(about(order(p, d, q).validate()), "parameter order");
    }
    assert_eq!(about(ArimaParams { max_iterations: 0, ..order(1, 0, 0) }.validate()), "parameter max_iterations");
    for bad in [0.0, f64::NAN, f64::INFINITY] {
        assert_eq!(about(ArimaParams { tolerance: bad, ..order(1, 0, 0) }.validate()), "parameter tolerance");
    }
    assert_eq!(about(AutoArimaParams { max_d: 5, ..AutoArimaParams::default() }.validate()), "parameter order");
    let parts = ArimaParts { ar: vec![0.5], difference: 1, ma: vec![], mean: 0.0, variance: 1.0 };
    let model = Arima::new(parts).unwrap();
    let plan = order(1, 1, 0).validate().unwrap();
    let auto = AutoArimaParams::default().validate().unwrap();
    let series: Vec<f64> = (0..60).map(|i| f64::from(i * i % 7)).collect();
    let mut state = model.filter(&series).unwrap().state;
    for (bad, expected) in [(f64::INFINITY, "finite series"), (HUGE, "range series")] {
        let mut y = series.clone();
        y[7] = bad;
        assert_eq!(about(model.log_likelihood(&y)), expected);
        assert_eq!(about(model.filter(&y)), expected);
        assert_eq!(about(plan.fit(&y)), expected);
        assert_eq!(about(auto.fit(&y)), expected);
        assert_eq!(about(kpss(&y)), expected);
        assert_eq!(about(state.append(bad)), expected);
    }
    assert_eq!(about(kpss(&[1.0, 2.0])), "few KPSS test");
    assert!(about(model.filter(&[f64::NAN])).starts_with("few "));
    assert!(about(plan.fit(&series[..3])).starts_with("few "));
    assert_eq!(about(plan.fit(&[1.0; 60])), "degenerate");
}

#[test]
fn sequences_refuse_gaps_joints_and_mixtures_that_do_not_fit() {
    let model = |start_s, end_s, mixture: &Mixture| ElementModel {
        element: MotionElement { start_s, end_s },
        mixture: mixture.clone(),
    };
    let (flat, single) = (pair(), pair().marginal(&[0]).unwrap());
    let new = |elements, blend_s| about(ElementSequence::new(ElementSequenceParts { elements, blend_s }));
    let two = || vec![model(0.0, 1.0, &flat), model(1.0, 2.0, &flat)];
    assert_eq!(new(two(), 0.2), "ok");
    assert_eq!(new(vec![], 0.2), "few element sequence");
    for blend_s in [-1.0, f64::NAN, 0.0, 1.5] {
        assert_eq!(new(two(), blend_s), "parameter blend_s");
    }
    assert_eq!(new(vec![model(0.0, 1.0, &flat)], f64::INFINITY), "parameter blend_s");
    assert_eq!(new(vec![model(0.0, 1.0, &single)], 0.0), "parameter element mixture dimension");
    assert_eq!(new(vec![two()[0].clone(), model(1.0, 2.0, &single)], 0.2), "length element mixture dimension");
    assert_eq!(new(vec![two()[0].clone(), model(1.1, 2.0, &flat)], 0.2), "parameter element start_s");
    assert_eq!(new(vec![model(0.0, 0.0, &flat)], 0.0), "parameter element end_s");
    assert_eq!(new(vec![model(0.0, f64::INFINITY, &flat)], 0.0), "parameter element end_s");

    let plan = GmmParams::default().validate().unwrap();
    let motion = line(21, 1);
    let elements = segment_fixed(&motion, 1.0).unwrap();
    let learn = |demonstrations: &[Trajectory]| about(ElementSequence::learn(demonstrations, &elements, 0.2, &plan));
    assert_eq!(learn(&[]), "few demonstrations");
    assert_eq!(learn(&[motion.clone(), line(21, 2)]), "length demonstration dimension");
    let fused = |errors: &[Vec<f64>]| {
        let reading = FusionReading::Components;
        about(ElementSequence::learn_fused(std::slice::from_ref(&motion), &elements, 0.2, &plan, errors, reading))
    };
    assert_eq!(fused(&[]), "length ARIMA errors, demonstrations");
    assert_eq!(fused(&[vec![1.0; 3]]), "length ARIMA errors, samples");

    let sequence = ElementSequence::new(ElementSequenceParts { elements: two(), blend_s: 0.2 }).unwrap();
    let alone = ElementSequence::new(ElementSequenceParts { elements: two()[..1].to_vec(), blend_s: 0.2 }).unwrap();
    let (regressor, other) = (sequence.regressor().unwrap(), alone.regressor().unwrap());
    assert_eq!(about(regressor.predict_into(0.5, &mut other.prediction())), "length sequence prediction");
    assert_eq!(about(regressor.predict_into(f64::NAN, &mut regressor.prediction())), "finite time_s");
}

#[test]
fn a_demonstration_column_that_no_arima_fits_is_an_error_unless_it_is_constant() {
    let plan = ArimaParams::default().validate().unwrap();
    assert!(about(arima_errors(&[line(2, 1)], &plan)).starts_with("few "));
}
