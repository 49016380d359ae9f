"""ARIMA against the multivariate normal density and recurrences."""

import numpy as np
import pytest

import ogg_rs


def series(n=120, phi=0.7, seed=0):
    rng = np.random.default_rng(seed)
    y = [rng.normal() / np.sqrt(1 - phi**2)]
    for _ in range(n - 1):
        y.append(phi * y[-1] + rng.normal())
    return 5.0 + np.array(y)


def log_normal(y, mean, covariance):
    gap = y - mean
    return -0.5 * (gap @ np.linalg.solve(covariance, gap) + np.linalg.slogdet(2 * np.pi * covariance)[1])


def ar1_covariance(n, phi, variance):
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return variance * phi**lag / (1 - phi**2)


def test_the_likelihood_of_an_ar1_is_that_of_its_normal_density():
    y = series()
    model = ogg_rs.Arima((1, 0, 0)).fit(y)
    mean, phi, variance = model.params_
    want = log_normal(y, mean, ar1_covariance(len(y), phi, variance))
    assert model.loglike_ == pytest.approx(want, rel=1e-10)
    assert model.loglike_at([4.0, 0.5, 2.0], y) == pytest.approx(
        log_normal(y, 4.0, ar1_covariance(len(y), 0.5, 2.0)), rel=1e-10
    )


def test_the_likelihood_of_an_ma1_is_that_of_its_normal_density():
    y = series() - 5.0
    lag = np.abs(np.subtract.outer(np.arange(len(y)), np.arange(len(y))))
    covariance = 2.0 * np.where(lag == 0, 1 + 0.4**2, np.where(lag == 1, 0.4, 0.0))
    got = ogg_rs.Arima((0, 0, 1), trend="n").loglike_at([0.4, 2.0], y)
    assert got == pytest.approx(log_normal(y, 0.0, covariance), rel=1e-10)


def test_no_neighbour_of_the_estimate_is_likelier():
    y = series()
    model = ogg_rs.Arima((1, 0, 1)).fit(y)
    for i in range(4):
        for step in (-1e-3, 1e-3):
            params = model.params_.copy()
            params[i] += step
            assert model.loglike_at(params, y) <= model.loglike_ + 1e-9


def test_predictions_residuals_and_forecasts_follow_the_recurrence():
    y = series()
    model = ogg_rs.Arima((1, 0, 0)).fit(y)
    mean, phi, variance = model.params_
    np.testing.assert_allclose(model.fittedvalues_[1:], mean + phi * (y[:-1] - mean), rtol=1e-10)
    np.testing.assert_allclose(model.resid_, y - model.fittedvalues_, atol=1e-10)
    means, variances = model.forecast(4, return_var=True)
    power = phi ** np.arange(1, 5)
    np.testing.assert_allclose(means, mean + power * (y[-1] - mean), rtol=1e-10)
    np.testing.assert_allclose(variances, variance * (1 - power**2) / (1 - phi**2), rtol=1e-9)


def test_a_differenced_series_keeps_its_drift():
    y = np.cumsum(series())
    model = ogg_rs.Arima((1, 1, 0), trend="c").fit(y)
    inner = ogg_rs.Arima((1, 0, 0)).fit(np.diff(y))
    np.testing.assert_allclose(model.params_, inner.params_, rtol=1e-5)
    assert model.loglike_ == pytest.approx(inner.loglike_, rel=1e-9)
    assert np.isnan(model.fittedvalues_[0])


def test_appended_values_move_the_forecast_but_not_the_parameters():
    y = series()
    model = ogg_rs.Arima((1, 0, 0)).fit(y)
    mean, phi, _ = before = model.params_.copy()
    model.append([8.0])
    np.testing.assert_array_equal(model.params_, before)
    assert model.forecast(1)[0] == pytest.approx(mean + phi * (8.0 - mean), rel=1e-12)


def test_the_automatic_order_beats_its_neighbours():
    y = series(200)
    chosen = ogg_rs.auto_arima(y, max_p=2, max_d=1, max_q=2)

    def aicc(model):
        k, n = len(model.params_), len(y) - model.order[1]
        return 2 * k - 2 * model.loglike_ + 2 * k * (k + 1) / (n - k - 1)

    assert chosen.order[1] == 0
    for p in range(3):
        for q in range(3):
            for trend in ("n", "c"):
                assert aicc(chosen) <= aicc(ogg_rs.Arima((p, 0, q), trend=trend).fit(y)) + 1e-6


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ogg_rs.NumericalError):
        ogg_rs.Arima().fit(np.zeros(30))
    for call in (lambda: ogg_rs.Arima((1, 0)), lambda: ogg_rs.Arima((-1, 0, 0)), lambda: ogg_rs.Arima(trend="ct")):
        with pytest.raises(ogg_rs.InvalidParameter):
            call()
    with pytest.raises(ogg_rs.InvalidParameter):
        ogg_rs.Arima().fit([1.0])
