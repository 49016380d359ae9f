"""Names and signatures that scripts are written against."""

import importlib
import inspect

import numpy as np
import pytest

import ogg_rs
from ogg_rs import can, kin, motion, plot, pose, recording, sim

MIXTURE = {
    "n_components": 1, "covariance_type": "full", "tol": 1e-3, "reg_covar": 1e-6, "max_iter": 100, "n_init": 1,
    "init_params": "kmeans", "random_state": None, "warm_start": False, "weights_init": None, "means_init": None,
    "precisions_init": None, "weight_fusion": None,
}  # fmt: skip


@pytest.mark.parametrize("estimator", [ogg_rs.GaussianMixture, ogg_rs.GaussianMixtureRegressor])
def test_the_estimators_take_scikit_learns_arguments(estimator):
    parameters = inspect.signature(estimator).parameters
    assert {name: parameter.default for name, parameter in parameters.items()} == MIXTURE
    kinds = [parameter.kind for parameter in parameters.values()]
    assert kinds[0] is inspect.Parameter.POSITIONAL_OR_KEYWORD
    assert set(kinds[1:]) == {inspect.Parameter.KEYWORD_ONLY}


# What may be given by place, in order, and what by name only.
CALLS = [
    (ogg_rs.GaussianMixture.fit, ["X", "y"], ["sample_weight"]),
    (ogg_rs.GaussianMixture.condition, ["indices", "values"], []),
    (ogg_rs.GaussianMixture.sample, ["n_samples"], []),
    (ogg_rs.GaussianMixtureRegressor.fit, ["X", "y"], ["sample_weight"]),
    (ogg_rs.GaussianMixtureRegressor.predict, ["X", "return_cov"], []),
    (ogg_rs.GaussianMixtureRegressor.predict_derivative, ["X"], []),
    (ogg_rs.Arima.__init__, ["order"], ["trend"]),
    (ogg_rs.Arima.fit, ["y"], []),
    (ogg_rs.Arima.forecast, ["steps", "return_var"], []),
    (ogg_rs.Arima.append, ["y"], []),
    (ogg_rs.Arima.loglike_at, ["params", "y"], []),
    (pose.evaluate_keypoints, ["gt", "dt"], None),
    (kin.Robot.from_urdf, ["path", "base", "tip"], []),
    (kin.Robot.fk, ["q"], []),
    (kin.Robot.jacobian, ["q"], []),
    (kin.Robot.ik, ["target", "seed"], []),
    (kin.Robot.mass_matrix, ["q"], []),
    (kin.Robot.inverse_dynamics, ["q", "qd", "qdd"], ["gravity_m_s2"]),
    (motion.Tracker.__init__, ["limits", "dt"], None),
    (ogg_rs.MotionModel.teach, ["demonstrations"], None),
    (ogg_rs.MotionModel.predict, ["t", "return_cov"], []),
    (ogg_rs.MotionModel.load, ["path"], []),
    (ogg_rs.MotionModel.save, ["path"], []),
    (recording.open, ["path"], []),
    (recording.to_lerobot, ["path", "out"], None),
]


@pytest.mark.parametrize(("call", "placed", "named"), CALLS, ids=lambda given: getattr(given, "__qualname__", ""))
def test_a_call_takes_these_arguments(call, placed, named):
    parameters = [p for p in inspect.signature(call).parameters.values() if p.name != "self"]
    assert [p.name for p in parameters if p.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD] == placed
    if named is not None:
        assert [p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY] == named


def test_every_promised_name_is_there():
    for name in (
        "predict_proba", "score", "score_samples", "bic", "aic", "select_order", "fit_predict", "get_params", "set_params",
    ):  # fmt: skip
        assert callable(getattr(ogg_rs.GaussianMixture, name))
    fitted = ogg_rs.GaussianMixture().fit([[0.0], [1.0], [2.0]])
    for name in (
        "weights_", "means_", "covariances_", "precisions_cholesky_", "converged_", "n_iter_", "lower_bound_", "lower_bounds_",
    ):  # fmt: skip
        assert hasattr(fitted, name)
    walk = ogg_rs.Arima((0, 1, 0)).fit([0.0, 1.0, 0.5, 2.0])
    for name in ("params_", "loglike_", "fittedvalues_", "resid_"):
        assert hasattr(walk, name)
    for home, names in {
        pose: ("encode_targets", "fuse_labels", "decode", "Estimator", "evaluate_keypoints", "SKELETONS", "convert"),
        sim: ("Arm", "Worker"),
        can: ("Protocol", "DBC_PATH"),
        plot: ("tracks", "components", "variance_band", "tracking_error", "motion_model"),
    }.items():
        assert set(names) <= set(home.__all__)


@pytest.mark.parametrize("home", ["", ".can", ".kin", ".motion", ".plot", ".pose", ".recording", ".sim"])
def test_everything_public_says_what_it_is(home):
    module = importlib.import_module(f"ogg_rs{home}")
    for name in module.__all__:
        given = getattr(module, name)
        if inspect.isclass(given) or inspect.isfunction(given):
            assert inspect.getdoc(given), name


def test_what_needs_no_conversion_and_what_does_give_the_same_numbers():
    """Arrays that are ready go to the native half at once; lists, other orders and types go the long way round."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(40, 3))
    mixture = ogg_rs.GaussianMixture(2, random_state=0, max_iter=500).fit(x)
    one = ogg_rs.GaussianMixtureRegressor(2, random_state=0, max_iter=500).fit(x[:, :2], x[:, 2])
    two = ogg_rs.GaussianMixtureRegressor(2, random_state=0, max_iter=500).fit(x[:, :1], x[:, 1:])
    robot = kin.Robot.builtin()
    q = rng.uniform(-1.0, 1.0, (2, 5, 6))
    cases = [
        (mixture.predict, x), (mixture.predict_proba, x), (mixture.score_samples, x), (one.predict, x[:, :2].copy()),
        (two.predict, x[:, :1].copy()), (robot.fk, q), (robot.fk, q[0, 0].copy()), (robot.jacobian, q),
    ]  # fmt: skip
    for call, ready in cases:
        want = call(ready)
        assert want.flags.c_contiguous and want.flags.writeable
        for other in (ready.tolist(), np.asfortranarray(ready), ready.astype(">f8"), ready.view(np.ma.MaskedArray)):
            got = call(other)
            assert got.shape == want.shape and type(got) is np.ndarray
            np.testing.assert_array_equal(got, want)


def test_faults_of_arrays_that_look_ready_are_named():
    mixture = ogg_rs.GaussianMixture().fit([[0.0, 0.0], [1.0, 2.0], [3.0, 1.0]])
    for wrong, said in (
        (np.zeros((2, 3)), "3 features, but GaussianMixture is expecting 2"),
        (np.zeros((0, 2)), "0 sample"),
        (np.zeros(2), "2D array"),
        (np.array([[np.inf, 0.0]]), "inf"),
    ):
        with pytest.raises(ogg_rs.InvalidParameter, match=said):
            mixture.predict(wrong)
    with pytest.raises(ogg_rs.InvalidParameter, match="NaN"):
        kin.Robot.builtin().fk(np.full(6, np.nan))
