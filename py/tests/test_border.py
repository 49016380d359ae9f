"""Whatever is handed over the border, the answer is a result or a typed error: never a crash, never another exception."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ogg_rs
from ogg_rs import kin, motion, pose, sim

DTYPES = ["<f8", ">f8", "<f4", ">f4", "<f2", "i1", "<i2", ">i4", "<i8", "u1", "<u2", "<u8", "?", "<c8", "<c16", "O", "U3", "M8[s]"]
EXTREMES = np.array([0.0, -0.0, 1.0, 5e-324, 1e-300, -1e-160, 1e155, -1e300, 1.7e308, np.inf, -np.inf, np.nan])
ODDITIES = [None, "a", 1.5, {}, [1]]


def wild(rng, shape):
    """Float64 values, some of them extreme."""
    values = rng.uniform(-4.0, 4.0, shape)
    share = rng.choice([0.0, 0.0, 0.2, 1.0])
    return np.where(rng.random(shape) < share, rng.choice(EXTREMES, shape), values)


def anything(rng):
    """Any dtype, order, stride, emptiness, and values from tiny to infinite."""
    shape = tuple(rng.choice([0, 1, 2, 3, 6, 7], rng.integers(0, 5)))
    dtype = np.dtype(str(rng.choice(DTYPES)))
    if dtype.kind == "O":
        array = np.empty(shape, object)
        array[...] = None
        array.fill(ODDITIES[rng.integers(len(ODDITIES))])
    elif dtype.kind in "UM":
        array = rng.integers(0, 9, shape).astype(dtype)
    else:
        with np.errstate(all="ignore"):
            array = np.asarray(wild(rng, shape).astype(dtype))
    form = rng.choice(["plain", "plain", "fortran", "strided", "reversed", "readonly", "odd address", "list"])
    if form == "fortran":
        array = np.asfortranarray(array)
    elif form == "strided" and array.ndim:
        array = np.repeat(array, 2, axis=-1)[..., ::2]
    elif form == "reversed" and array.ndim:
        array = array[::-1]
    elif form == "odd address" and array.dtype.kind not in "OM":
        array = np.ndarray(array.shape, array.dtype, b"\0" + array.tobytes() + b"\0", offset=1)
    elif form == "readonly":
        array.flags.writeable = False
    return array.tolist() if form == "list" else array


ROBOT = kin.Robot.builtin()
FITTED = ogg_rs.GaussianMixture(2, random_state=0).fit([[0.0, 1.0], [1.0, 0.0], [5.0, 5.0], [6.0, 4.0]])
REGRESSOR = ogg_rs.GaussianMixtureRegressor(random_state=0).fit([[0.0], [1.0], [2.0]], [0.0, 1.1, 1.9])
WALK = ogg_rs.Arima((0, 1, 0)).fit([0.0, 1.0, 0.5, 2.0])
LIMITS = [motion.JointLimits(lower_rad=-1, upper_rad=1, velocity_rad_s=1, acceleration_rad_s2=5, jerk_rad_s3=50)] * 2
ARM = sim.Arm()
WORKER = sim.Worker()
NETWORK = pose.Estimator("builtin:ogg-lite", onnxruntime="tract")
MAPS = pose.TargetMaps(*(np.zeros((1, c, 2, 2), np.float32) for c in (9, 14, 9, 14)))
TAUGHT = ogg_rs.MotionModel.teach([(np.arange(0, 3, 0.05), sim.Worker(variation=0).poses(np.arange(0, 3, 0.05)).arm())])

CALLS = {
    "mixture fit": lambda a, b: ogg_rs.GaussianMixture(2, max_iter=3, random_state=0).fit(a, sample_weight=b),
    "mixture start": lambda a, b: ogg_rs.GaussianMixture(2, max_iter=3, means_init=b, random_state=0).fit(a),
    "mixture fusion": lambda a, b: ogg_rs.GaussianMixture(
        1, max_iter=3, weight_fusion=ogg_rs.WeightFusion(errors=b)
    ).fit(a),
    "mixture random": lambda a, b: ogg_rs.GaussianMixture(2, init_params="random", max_iter=3, random_state=0).fit(a),
    "mixture order": lambda a, b: ogg_rs.GaussianMixture(max_iter=3).select_order(a, k_max=2, sample_weight=b),
    "mixture predict": lambda a, b: FITTED.predict_proba(a),
    "mixture score": lambda a, b: FITTED.score_samples(a),
    "mixture condition": lambda a, b: FITTED.condition([0], a),
    "regressor fit": lambda a, b: ogg_rs.GaussianMixtureRegressor(max_iter=3).fit(a, b),
    "regressor predict": lambda a, b: REGRESSOR.predict(a, return_cov=True),
    "regressor derivative": lambda a, b: REGRESSOR.predict_derivative(a),
    "arima fit": lambda a, b: ogg_rs.Arima((1, 0, 0)).fit(a),
    "arima likelihood": lambda a, b: WALK.loglike_at(a, b),
    "fk": lambda a, b: ROBOT.fk(a),
    "ik": lambda a, b: ROBOT.ik(a, b),
    "mass matrix": lambda a, b: ROBOT.mass_matrix(a),
    "inverse dynamics": lambda a, b: ROBOT.inverse_dynamics(a, b, gravity_m_s2=[0, 0, -9.81]),
    "track": lambda a, b: motion.Tracker(LIMITS, 0.01).track(a, b),
    "tracker start": lambda a, b: motion.Tracker(LIMITS, 0.01, start=a),
    "arm run": lambda a, b: sim.Arm().run(a, b, dt=0.001),
    "gravity load": lambda a, b: ARM.gravity_load(a),
    "worker": lambda a, b: WORKER.poses(a),
    "model predict": lambda a, b: TAUGHT.predict(a, return_cov=True),
    "model teach": lambda a, b: ogg_rs.MotionModel.teach([(a, b)]),
    "targets": lambda a, b: pose.encode_targets(a, b, b, size=(16, 16), skeleton="upper-limb-8"),
    "fusion": lambda a, b: pose.fuse_labels(MAPS, a, b),
    "decode": lambda a, b: pose.decode(a, b, skeleton="upper-limb-8"),
    "evaluation": lambda a, b: pose.evaluate_keypoints(
        [{"image_id": 1, "keypoints": a, "bbox": b, "area": 9.0}], [{"image_id": 1, "keypoints": b, "score": a}]
    ),
    "picture": lambda a, b: NETWORK.estimate(a),
    "convert": lambda a, b: pose.convert(a, "coco-17", "openpose-18"),
}


def survives(call, a, b):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            call(a, b)
        except ogg_rs.OggError as error:
            assert str(error) and error.kind


SEEDS = st.integers(0, 2**32 - 1)
PLAIN = settings(max_examples=360, deadline=None, database=None, derandomize=True)


@pytest.mark.parametrize("name", CALLS)
@PLAIN
@given(SEEDS)
def test_anything_is_a_result_or_a_typed_error(name, seed):
    rng = np.random.default_rng(seed)
    survives(CALLS[name], anything(rng), anything(rng))


SHAPED = {
    "mixture fit": ((6, 2), (6,)),
    "mixture start": ((6, 2), (2, 2)),
    "mixture fusion": ((6, 2), (6,)),
    "mixture random": ((6, 2), (1,)),
    "mixture predict": ((4, 2), (1,)),
    "regressor fit": ((6, 2), (6, 2)),
    "regressor predict": ((3, 1), (1,)),
    "arima fit": ((9,), (1,)),
    "arima likelihood": ((1,), (9,)),
    "fk": ((3, 6), (1,)),
    "ik": ((2, 4, 4), (6,)),
    "inverse dynamics": ((3, 6), (6,)),
    "track": ((5, 2), (5, 2)),
    "arm run": ((3, 6), (3, 6)),
    "model predict": ((5,), (1,)),
    "model teach": ((12,), (12, 3, 3)),
    "fusion": ((1, 9, 2, 2), (1, 14, 2, 2)),
    "decode": ((9, 3, 3), (14, 3, 3)),
}


@pytest.mark.parametrize("name", SHAPED)
@settings(PLAIN, max_examples=120)
@given(SEEDS)
def test_any_values_of_the_right_shape_are_a_result_or_a_typed_error(name, seed):
    rng = np.random.default_rng(seed)
    survives(CALLS[name], *(wild(rng, shape) for shape in SHAPED[name]))


def test_there_are_ten_thousand_cases():
    assert 360 * len(CALLS) + 120 * len(SHAPED) >= 10_000
