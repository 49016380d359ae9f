"""Every exception class is raised by the native half, is also the builtin it promises to be, and keeps the details."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

import ogg_rs
from ogg_rs import kin


def test_a_parameter_out_of_its_interval_is_also_a_value_error():
    with pytest.raises(ValueError, match="at least 3 samples, got 2") as caught:
        ogg_rs.GaussianMixture(3).fit(np.zeros((2, 1)))
    assert type(caught.value) is ogg_rs.InvalidParameter
    assert caught.value.kind == "TooFewSamples"
    assert "needed: 3" in caught.value.detail


def test_a_collapse_is_also_an_arithmetic_error():
    with pytest.raises(ArithmeticError) as caught:
        ogg_rs.GaussianMixture(1, reg_covar=0.0).fit(np.zeros((4, 1)))
    assert type(caught.value) is ogg_rs.NumericalError
    assert caught.value.kind == "AllRestartsFailed"
    assert "CollapsedComponent" in caught.value.detail


def test_a_missing_file_is_also_an_os_error(tmp_path):
    for load in (kin.Robot.from_urdf, ogg_rs.MotionModel.load):
        with pytest.raises(OSError, match="absent") as caught:
            load(tmp_path / "absent")
        assert type(caught.value) is ogg_rs.DeviceError


def test_text_that_is_no_model_says_where():
    with pytest.raises(ogg_rs.InvalidParameter, match="line 1 column 1") as caught:
        ogg_rs.MotionModel("pose")
    assert caught.value.kind == "ModelFile"


def test_an_unfitted_estimator_says_so():
    for call in (ogg_rs.GaussianMixture().predict, ogg_rs.GaussianMixtureRegressor().predict):
        with pytest.raises(ogg_rs.NotFitted):
            call([[0.0]])
    with pytest.raises(ogg_rs.NotFitted):
        ogg_rs.Arima().forecast(1)


def test_errors_survive_a_pickle():
    with pytest.raises(ogg_rs.OggError) as caught:
        kin.Robot.builtin().fk([np.nan] * 6)
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.kind, copy.detail) == (str(caught.value), caught.value.kind, caught.value.detail)


@pytest.mark.parametrize(
    "bad",
    [None, "text", [[1j]], [["a"]], [[1.0], [1.0, 2.0]], [1.0, 2.0], np.empty((0, 2)), np.empty((3, 0)), [[np.inf]] * 3,
     [[1e200]] * 3, {}, [[object()]]],
)  # fmt: skip
def test_arrays_that_make_no_sense_are_typed_errors(bad):
    with pytest.raises(ogg_rs.InvalidParameter):
        ogg_rs.GaussianMixture().fit(bad)


def test_an_unfitted_estimator_is_also_scikit_learns_own_error():
    with pytest.raises(NotFittedError) as caught:
        ogg_rs.GaussianMixture().predict([[0.0]])
    assert isinstance(caught.value, ogg_rs.NotFitted) and caught.value.kind == "NotFitted"
    assert type(pickle.loads(pickle.dumps(caught.value))) is ogg_rs.NotFitted


def test_the_classes_are_the_builtins_they_promise_to_be():
    promises = {
        ogg_rs.InvalidParameter: ValueError,
        ogg_rs.NumericalError: ArithmeticError,
        ogg_rs.DeviceError: OSError,
        ogg_rs.NotFitted: ValueError,
        ogg_rs.MissingDependency: ImportError,
    }
    for ours, builtin in promises.items():
        assert issubclass(ours, builtin) and issubclass(ours, ogg_rs.OggError)
    assert issubclass(ogg_rs.ConvergenceWarning, UserWarning)


ROOT = Path(__file__).parent.parent.parent
# The error type of each crate behind the package, and the function that sorts its variants.
TYPES = {
    "crates/gmr-core/src/error.rs": "class_of_mixture",
    "crates/kin/src/error.rs": "class_of_kin",
    "crates/motion/src/error.rs": "class_of_motion",
    "crates/follow/src/error.rs": "class_of_follow",
    "crates/pose/src/error.rs": "class_of_pose",
    "crates/sim/src/error.rs": "class_of_sim",
    "crates/can-driver/src/error.rs": "class_of_can",
    "crates/ogg/src/record/error.rs": "class_of_record",
}


@pytest.mark.skipif(not (ROOT / "crates").is_dir(), reason="the sources of the crates are not here")
@pytest.mark.parametrize("path", TYPES)
def test_every_variant_of_every_error_has_a_class(path):
    source = (ROOT / path).read_text()
    body = source[source.index("pub enum Error {") :]
    variants = re.findall(r"^    (\w+)(?: \{|\(|,)", body[: body.index("\n}")], re.MULTILINE)
    sorting = (ROOT / "py/src/failure.rs").read_text()
    function = sorting[sorting.index(f"fn {TYPES[path]}(") :]
    named = set(re.findall(r"E::(\w+)", function[: function.index("\n}")]))
    assert len(variants) > 3 and set(variants) - named == set()
