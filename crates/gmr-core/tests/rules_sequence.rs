//! Joined elements: the blend by its formula, whose clock, which samples, which moment belongs to which element.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Error, FusionReading, GmmParams, Mixture,
    MixtureParts, MotionElement, Phase, Regressor, SequencePrediction, Trajectory, segment_fixed,
};

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert!(
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance),
        "{what}: {a:?} is not {b:?}"
    );
}

/// A mixture of two over (t, x, y), different for each `i`.
fn mixture(i: usize) -> Mixture {
    let s = i as f64;
    let block = |a: f64, b: f64| vec![0.2, 0.1 * a, 0.05, 0.1 * a, 0.5 + a * a, 0.1, 0.05, 0.1, 0.4 + b * b];
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 3,
        weights: vec![0.4, 0.6],
        means: vec![0.2, s, 1.0 - s, 0.8, 1.0 + 2.0 * s, -s],
        covariances: [block(0.3 + s, 0.1), block(-0.5, 0.2 + s)].concat(),
    })
    .unwrap()
}

const ENDS: [f64; 4] = [10.0, 11.0, 12.5, 13.0];
const BLEND_S: f64 = 0.4;

fn models() -> Vec<ElementModel> {
    (0..3)
        .map(|i| ElementModel { element: MotionElement { start_s: ENDS[i], end_s: ENDS[i + 1] }, mixture: mixture(i) })
        .collect()
}

fn sequence() -> ElementSequence {
    ElementSequence::new(ElementSequenceParts { elements: models(), blend_s: BLEND_S }).unwrap()
}

fn at(time_s: f64) -> SequencePrediction {
    let regressor = sequence().regressor().unwrap();
    let mut out = regressor.prediction();
    regressor.predict_into(time_s, &mut out).unwrap();
    out
}

/// Mean, slope, covariance and log density of element `i` alone, at a time of the whole motion.
fn alone(i: usize, time_s: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>, f64) {
    let regressor = Regressor::new(&mixture(i), &[0], &[1, 2]).unwrap();
    let mut out = regressor.prediction();
    regressor.predict_with_jacobian_into(&[time_s - ENDS[i]], &mut out).unwrap();
    (out.mean().to_vec(), out.jacobian().to_vec(), out.covariance().to_vec(), out.log_density())
}

#[test]
fn in_a_joint_the_answer_is_the_blend_of_the_two_elements_by_its_formula() {
    for boundary in [1, 2] {
        for share in [0.05, 0.3, 0.5, 0.62, 0.97] {
            let t = ENDS[boundary] + BLEND_S * (share - 0.5);
            let (a, b) = (alone(boundary - 1, t), alone(boundary, t));
            let w = share * share * share * (10.0 - 15.0 * share + 6.0 * share * share);
            let slope = 30.0 * (share - share * share) * (share - share * share) / BLEND_S;
            let out = at(t);
            let gap = [b.0[0] - a.0[0], b.0[1] - a.0[1]];
            let mix = |x: f64, y: f64| (1.0 - w) * x + w * y;
            close("mean", out.mean(), &[mix(a.0[0], b.0[0]), mix(a.0[1], b.0[1])], 1e-13);
            let velocity = [mix(a.1[0], b.1[0]) + slope * gap[0], mix(a.1[1], b.1[1]) + slope * gap[1]];
            close("velocity", out.velocity(), &velocity, 1e-12);
            // The law of total covariance of a pair with shares 1 - w and w.
            let covariance: Vec<f64> =
                (0..4).map(|i| mix(a.2[i], b.2[i]) + w * (1.0 - w) * gap[i / 2] * gap[i % 2]).collect();
            close("covariance", out.covariance(), &covariance, 1e-12);
            close("density", &[out.log_density()], &[mix(a.3, b.3)], 1e-12);
            assert_eq!(out.element(), if share < 0.5 { boundary - 1 } else { boundary });
            assert_eq!(out.phase(), Phase::Within);
        }
    }
}

#[test]
fn outside_the_joints_the_answer_is_that_of_the_element_on_its_own_clock() {
    // The first half blend and the last belong to no joint.
    for (i, t) in [(0, 10.05), (0, 10.5), (1, 11.3), (1, 12.2), (2, 12.8), (2, 12.95)] {
        let (out, expected) = (at(t), alone(i, t));
        close("mean", out.mean(), &expected.0, 1e-13);
        close("velocity", out.velocity(), &expected.1, 1e-13);
        close("covariance", out.covariance(), &expected.2, 1e-13);
        close("density", &[out.log_density()], &[expected.3], 1e-13);
        assert_eq!((out.element(), out.phase()), (i, Phase::Within));
    }
}

#[test]
fn before_and_after_the_motion_the_pose_of_its_end_is_held_at_rest() {
    for (t, end, element, phase) in [
        (-1e9, 10.0, 0, Phase::Before),
        (9.999, 10.0, 0, Phase::Before),
        (13.001, 13.0, 2, Phase::After),
        (1e9, 13.0, 2, Phase::After),
    ] {
        let (out, expected) = (at(t), alone(element, end));
        close("mean", out.mean(), &expected.0, 1e-13);
        close("covariance", out.covariance(), &expected.2, 1e-13);
        assert_eq!((out.velocity(), out.element(), out.phase()), (&[0.0, 0.0][..], element, phase));
    }
    // The ends themselves are within, and moving.
    for (t, element) in [(10.0, 0), (13.0, 2)] {
        let out = at(t);
        assert_eq!((out.phase(), out.element()), (Phase::Within, element));
        close("velocity", out.velocity(), &alone(element, t).1, 1e-13);
    }
    // A boundary belongs to the element that begins there.
    assert_eq!(at(11.0).element(), 1);
}

#[test]
fn elements_must_follow_one_another_within_a_nanosecond_and_be_as_long_as_the_blend() {
    let with = |change: &dyn Fn(&mut ElementSequenceParts)| {
        let mut parts = ElementSequenceParts { elements: models(), blend_s: BLEND_S };
        change(&mut parts);
        ElementSequence::new(parts).map(|_| ())
    };
    assert_eq!(with(&|p| p.elements[1].element.start_s += 5e-10), Ok(()));
    for gap in [0.1, -0.1, 1e-6, -1e-6] {
        let refused = with(&|p| p.elements[2].element.start_s += gap);
        assert!(matches!(refused, Err(Error::InvalidParameter { name: "element start_s", .. })), "{gap}");
    }
    assert_eq!(with(&|p| p.blend_s = 0.5), Ok(()));
    let refused = with(&|p| p.blend_s = 0.51);
    assert!(matches!(refused, Err(Error::InvalidParameter { name: "blend_s", .. })));
    // Alone, an element has no joint: any blend fits.
    assert_eq!(
        with(&|p| {
            p.elements.truncate(1);
            p.blend_s = 50.0;
        }),
        Ok(())
    );
}

#[test]
fn an_element_is_learned_from_all_samples_within_half_a_blend_of_it_on_its_own_clock() {
    // One component: mean and covariance of the chosen rows, by hand.
    let times: Vec<f64> = (0..=40).map(|i| 5.0 + 0.05 * f64::from(i)).collect();
    let motion = |shift: f64| {
        let values = times.iter().map(|t| (3.0 * t).sin() + shift).collect();
        Trajectory::new(times.clone(), values, 1).unwrap()
    };
    let demonstrations = [motion(0.0), motion(0.3)];
    let elements = segment_fixed(&demonstrations[0], 1.0).unwrap();
    let plan = GmmParams::default().validate().unwrap();
    let (sequence, reports) = ElementSequence::learn(&demonstrations, &elements, 0.2, &plan).unwrap();
    assert_eq!(reports.len(), 2);
    for (model, (from, to)) in sequence.parts().elements.iter().zip([(0, 22), (18, 40)]) {
        let rows: Vec<[f64; 2]> = [0.0, 0.3]
            .iter()
            .flat_map(|shift| times[from..=to].iter().map(move |t| [*t, (3.0 * t).sin() + shift]))
            .map(|[t, h]| [t - model.element.start_s, h])
            .collect();
        let n = rows.len() as f64;
        let mean: [f64; 2] = std::array::from_fn(|j| rows.iter().map(|r| r[j]).sum::<f64>() / n);
        close("mean", model.mixture.mean(0), &mean, 1e-12);
        let covariance: Vec<f64> = (0..4)
            .map(|i| rows.iter().map(|r| (r[i / 2] - mean[i / 2]) * (r[i % 2] - mean[i % 2])).sum::<f64>() / n)
            .collect();
        close("covariance", &model.mixture.covariance(0), &covariance, 1e-12);
    }
}

#[test]
fn fused_learning_gives_each_element_the_errors_of_its_own_samples() {
    let times: Vec<f64> = (0..=80).map(|i| 0.025 * f64::from(i)).collect();
    let values: Vec<f64> =
        times.iter().map(|t| if t % 1.0 < 0.5 { 0.0 } else { 5.0 } + 0.1 * (40.0 * t).sin()).collect();
    let motion = Trajectory::new(times.clone(), values, 1).unwrap();
    let elements = segment_fixed(&motion, 1.0).unwrap();
    let plan = GmmParams { components: 2, ..GmmParams::default() }.validate().unwrap();
    // No error in the first element; in the second, one half of the samples is badly predicted.
    let errors: Vec<f64> = times.iter().map(|t| if *t > 1.5 { 3.0 } else { 0.0 }).collect();
    let demonstrations = std::slice::from_ref(&motion);
    let reading = FusionReading::Components;
    let (_, reports) =
        ElementSequence::learn_fused(demonstrations, &elements, 0.05, &plan, &[errors], reading).unwrap();
    let reliability = |i: usize| reports[i].fusion.as_ref().unwrap().steps[0].reliability.clone();
    assert!(reliability(0).iter().all(|r| r.abs() < 1e-12), "{:?}", reliability(0));
    let second = reliability(1);
    let (low, high) = (second[0].min(second[1]), second[0].max(second[1]));
    assert!(low < 0.5 && high > 2.5, "{second:?}");
}
