"""Regression against the formulas written out in NumPy, and finite differences."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.metrics import r2_score

import ogg_rs


def data(n=300):
    rng = np.random.default_rng(0)
    x = rng.uniform(-3.0, 3.0, (n, 2))
    y = np.column_stack((np.sin(x[:, 0]) + 0.3 * x[:, 1], x[:, 0] * x[:, 1])) + 0.1 * rng.normal(size=(n, 2))
    return x, y


def by_hand(model, query):
    """Conditional mean and covariance of a joint mixture over two inputs and two outputs."""
    i, o = slice(0, 2), slice(2, 4)
    shares, means, seconds = [], [], []
    for w, m, s in zip(model.weights_, model.means_, model.covariances_, strict=True):
        gap = query - m[i]
        inverse = np.linalg.inv(s[i, i])
        shares.append(w * np.exp(-0.5 * gap @ inverse @ gap) / np.sqrt(np.linalg.det(2 * np.pi * s[i, i])))
        mean = m[o] + s[o, i] @ inverse @ gap
        means.append(mean)
        seconds.append(s[o, o] - s[o, i] @ inverse @ s[i, o] + np.outer(mean, mean))
    shares = np.array(shares) / np.sum(shares)
    mean = shares @ np.array(means)
    return mean, np.einsum("k,kij->ij", shares, seconds) - np.outer(mean, mean)


def test_mean_and_covariance_are_the_conditional_ones():
    x, y = data()
    model = ogg_rs.GaussianMixtureRegressor(5, random_state=0, max_iter=1000).fit(x, y)
    queries = x[:20] + 0.01
    means, covariances = model.predict(queries, return_cov=True)
    np.testing.assert_allclose(means, model.predict(queries), rtol=1e-12)
    for query, mean, covariance in zip(queries, means, covariances, strict=True):
        want_mean, want_covariance = by_hand(model, query)
        np.testing.assert_allclose(mean, want_mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(covariance, want_covariance, rtol=1e-7, atol=1e-9)


def test_the_derivative_is_that_of_the_prediction():
    x, y = data()
    model = ogg_rs.GaussianMixtureRegressor(5, random_state=0, max_iter=1000).fit(x, y)
    slopes = model.predict_derivative(x[:20])
    assert slopes.shape == (20, 2, 2)
    h = 1e-5
    for j in range(2):
        step = h * np.eye(2)[j]
        numeric = (model.predict(x[:20] + step) - model.predict(x[:20] - step)) / (2 * h)
        # Third derivatives stay below 1e3 here: the error of the difference is below 1e-7.
        np.testing.assert_allclose(slopes[:, :, j], numeric, rtol=1e-6, atol=1e-6)


def test_one_component_is_least_squares():
    x, y = data()
    model = ogg_rs.GaussianMixtureRegressor(reg_covar=0.0).fit(x, y[:, 0])
    design = np.column_stack((x, np.ones(len(x))))
    solution = np.linalg.lstsq(design, y[:, 0], rcond=None)[0]
    mean, variance = model.predict(x, return_cov=True)
    assert mean.shape == variance.shape == (len(x),)
    np.testing.assert_allclose(mean, design @ solution, atol=1e-9)
    np.testing.assert_allclose(variance, np.mean((y[:, 0] - design @ solution) ** 2), rtol=1e-9)
    np.testing.assert_allclose(model.predict_derivative(x), np.tile(solution[:2], (len(x), 1)), atol=1e-9)


def test_score_is_r_squared():
    x, y = data()
    model = ogg_rs.GaussianMixtureRegressor(6, random_state=0, max_iter=1000).fit(x, y)
    assert model.score(x, y) == pytest.approx(r2_score(y, model.predict(x)), rel=1e-12)


def test_pickle_and_clone():
    x, y = data()
    model = ogg_rs.GaussianMixtureRegressor(3, random_state=0, max_iter=1000).fit(x, y)
    want = model.predict(x)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).predict(x), want)
    np.testing.assert_array_equal(clone(model).fit(x, y).predict(x), want)


def test_targets_that_do_not_fit_are_refused():
    x, y = data()
    for wrong in (y[:-1], y[:, :, None], np.empty((len(x), 0))):
        with pytest.raises(ogg_rs.InvalidParameter, match="y: expected"):
            ogg_rs.GaussianMixtureRegressor().fit(x, wrong)
    with pytest.raises(ogg_rs.InvalidParameter, match="has 1 features, but .* is expecting 2"):
        ogg_rs.GaussianMixtureRegressor().fit(x, y).predict(x[:, :1])


def test_what_is_not_known_of_a_query_is_integrated_out():
    rng = np.random.default_rng(0)
    joint = rng.multivariate_normal([0, 1, 2, 3], np.eye(4) + 0.5, 400)
    x, y = joint[:, :3], joint[:, 3]
    fit = ogg_rs.GaussianMixtureRegressor(reg_covar=0.0).fit(x, y)
    cov, mean = np.cov(joint.T, bias=True), joint.mean(axis=0)
    query = np.array([[0.5, np.nan, 1.0], [np.nan] * 3, [0.1, 0.2, 0.3]])
    got, spread = fit.predict(query, return_cov=True)
    for row, value, variance in zip(query, got, spread, strict=True):
        seen = np.flatnonzero(~np.isnan(row))
        slope = np.linalg.solve(cov[np.ix_(seen, seen)], cov[seen, 3]) if len(seen) else np.zeros(0)
        assert value == pytest.approx(mean[3] + slope @ (row[seen] - mean[seen]), rel=1e-9)
        assert variance == pytest.approx(cov[3, 3] - slope @ cov[seen, 3], rel=1e-9)
    np.testing.assert_array_equal(fit.predict(query), got)
    with pytest.raises(ogg_rs.InvalidParameter, match="finite"):
        fit.predict_derivative(query)
    for bad in (None, np.full(400, np.nan), np.full(400, np.inf)):
        with pytest.raises(ogg_rs.InvalidParameter):
            fit.fit(x, bad)
