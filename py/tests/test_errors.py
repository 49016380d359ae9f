"""Every exception class is raised by the native half, is also the builtin it promises to be, and keeps the details."""

import pickle

import numpy as np
import pytest

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
