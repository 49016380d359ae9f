"""scikit-learn's own checks of an estimator, and what it means to be one of its estimators."""

import functools
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import estimator_checks_generator

import ogg_rs

# Checks that fail, and why that is meant.
EXCEPTIONS = {
    "check_dtype_object": "text in an array of objects is refused, in words of our own",
    "check_sample_weight_equivalence_on_dense_data": "the start is drawn by rows, so a row of weight two is not drawn as "
    "two rows are; from a given start the fits are equal (test_a_weight_of_two_counts_as_two_rows)",
}
ESTIMATORS = [
    ogg_rs.GaussianMixture(2, max_iter=1000, random_state=0),
    ogg_rs.GaussianMixtureRegressor(2, max_iter=1000, random_state=0),
]


def checks():
    for estimator in ESTIMATORS:
        with warnings.catch_warnings():
            # The estimators do not inherit from scikit-learn's base class, so that it is not needed to use them.
            warnings.filterwarnings("ignore", message=".*does not inherit from `sklearn.base.BaseEstimator`")
            found = list(estimator_checks_generator(estimator, legacy=True))
        for made, check in found:
            name = check.func.__name__ if isinstance(check, functools.partial) else check.__name__
            reason = EXCEPTIONS.get(name)
            marks = pytest.mark.xfail(reason=reason, strict=True) if reason else ()
            yield pytest.param(made, check, marks=marks, id=f"{type(estimator).__name__}-{name}")


@pytest.mark.filterwarnings("ignore::ogg_rs.ConvergenceWarning")
@pytest.mark.filterwarnings("ignore::UserWarning:sklearn")
@pytest.mark.parametrize(("estimator", "check"), list(checks()))
def test_check_estimator(estimator, check):
    check(estimator)


def test_estimators_work_in_pipelines_and_searches():
    rng = np.random.default_rng(0)
    x = rng.uniform(-2, 2, (200, 1))
    y = np.sin(2 * x[:, 0]) + 0.05 * rng.normal(size=200)
    pipeline = make_pipeline(StandardScaler(), ogg_rs.GaussianMixtureRegressor(8, random_state=0, max_iter=500))
    assert clone(pipeline).fit(x, y).score(x, y) > 0.9
    search = GridSearchCV(
        ogg_rs.GaussianMixtureRegressor(random_state=0, max_iter=1000), {"n_components": [1, 8]}, cv=3
    ).fit(x, y)
    assert search.best_params_ == {"n_components": 8}
