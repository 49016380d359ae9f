"""GaussianMixture against scikit-learn, NumPy and closed forms."""

import copy
import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning as SklearnConvergenceWarning
from sklearn.mixture import GaussianMixture as Reference

import ogg_rs
from ogg_rs._start import precision_factors, start_mixture

KINDS = ["full", "tied", "diag", "spherical"]


def data(n=400, d=3, seed=0):
    rng = np.random.default_rng(seed)
    centres = 1.5 * rng.normal(size=(3, d))
    return centres[rng.integers(3, size=n)] + rng.normal(size=(n, d)) * rng.uniform(0.4, 1.2, d)


def start(kind, x, k=3):
    rng = np.random.default_rng(1)
    d = x.shape[1]
    base = np.linalg.inv(np.cov(x.T))
    precisions = {
        "full": np.stack([base * s for s in (1.0, 1.5, 2.0)]),
        "tied": base,
        "diag": np.tile(np.diag(base), (k, 1)),
        "spherical": np.full(k, base.trace() / d),
    }[kind]
    return {
        "weights_init": np.array([0.2, 0.3, 0.5]),
        "means_init": x[rng.choice(len(x), k, replace=False)],
        "precisions_init": precisions,
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.filterwarnings("ignore::ogg_rs.ConvergenceWarning")
@pytest.mark.parametrize("max_iter", [1, 7, 300])
def test_the_same_start_gives_the_numbers_of_scikit_learn(kind, max_iter):
    x = data()
    arguments = {"covariance_type": kind, "max_iter": max_iter, "tol": 1e-6, **start(kind, x)}
    theirs = Reference(3, **arguments).fit(x)
    ours = ogg_rs.GaussianMixture(3, **arguments).fit(x)
    assert (ours.n_iter_, ours.converged_) == (theirs.n_iter_, theirs.converged_)
    for name in ("weights_", "means_", "covariances_", "precisions_cholesky_", "lower_bound_"):
        got, want = getattr(ours, name), getattr(theirs, name)
        assert np.shape(got) == np.shape(want), name
        np.testing.assert_allclose(got, want, rtol=1e-8, atol=1e-8, err_msg=name)
    other = data(seed=5)
    np.testing.assert_allclose(ours.score_samples(other), theirs.score_samples(other), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(ours.predict_proba(other), theirs.predict_proba(other), rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(ours.predict(other), theirs.predict(other))
    for name in ("score", "bic", "aic"):
        assert getattr(ours, name)(other) == pytest.approx(getattr(theirs, name)(other), rel=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_those_of_scikit_learn_from_the_same_seed(kind):
    x = data()
    arguments = {"covariance_type": kind, "random_state": 3, "max_iter": 300, **start(kind, x)}
    ours, labels = ogg_rs.GaussianMixture(3, **arguments).fit(x).sample(50)
    theirs, their_labels = Reference(3, **arguments).fit(x).sample(50)
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(labels, their_labels)


def test_one_component_is_mean_and_covariance():
    x = data()
    fit = ogg_rs.GaussianMixture(reg_covar=0.0).fit(x)
    np.testing.assert_allclose(fit.means_[0], x.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(fit.covariances_[0], np.cov(x.T, bias=True), rtol=1e-10)


def test_a_weight_of_two_counts_as_two_rows():
    x = data(60)
    weights = np.where(np.arange(60) % 3 == 0, 2.0, 1.0)
    arguments = {"max_iter": 300, **start("full", x)}
    weighted = ogg_rs.GaussianMixture(3, **arguments).fit(x, sample_weight=weights)
    repeated = ogg_rs.GaussianMixture(3, **arguments).fit(np.repeat(x, weights.astype(int), axis=0))
    np.testing.assert_allclose(weighted.means_, repeated.means_, rtol=1e-8)


def test_values_not_seen_are_integrated_out():
    # Independent columns: the means of the seen values are the maximum of the likelihood.
    rng = np.random.default_rng(2)
    x = rng.normal(size=(200, 2))
    x[rng.random(x.shape) < 0.2] = np.nan
    fit = ogg_rs.GaussianMixture(covariance_type="diag", reg_covar=0.0, tol=1e-12, max_iter=1000).fit(x)
    np.testing.assert_allclose(fit.means_[0], np.nanmean(x, axis=0), atol=1e-5)
    np.testing.assert_allclose(fit.covariances_[0], np.nanvar(x, axis=0), atol=1e-5)


def test_conditioning_is_the_gaussian_formula():
    x = data()
    fit = ogg_rs.GaussianMixture(reg_covar=0.0).fit(x)
    given = fit.condition([1], [0.7])
    mean, cov = x.mean(axis=0), np.cov(x.T, bias=True)
    slope = cov[[0, 2], 1] / cov[1, 1]
    np.testing.assert_allclose(given.means_[0], mean[[0, 2]] + slope * (0.7 - mean[1]), rtol=1e-9)
    want = cov[np.ix_([0, 2], [0, 2])] - np.outer(slope, cov[1, [0, 2]])
    np.testing.assert_allclose(given.covariances_[0], want, rtol=1e-9)


@pytest.mark.parametrize("init", ["kmeans", "k-means++", "random", "random_from_data"])
def test_the_same_seed_gives_the_same_numbers(init):
    x = data()
    fits = [ogg_rs.GaussianMixture(3, init_params=init, random_state=4, n_init=3, max_iter=500).fit(x) for _ in range(2)]
    np.testing.assert_array_equal(fits[0].means_, fits[1].means_)


def test_a_warm_start_goes_on_where_the_last_fit_ended():
    x = data()
    arguments = {"tol": 0.0, **start("full", x)}
    with pytest.warns(ogg_rs.ConvergenceWarning):
        whole = ogg_rs.GaussianMixture(3, max_iter=6, **arguments).fit(x)
    parts = ogg_rs.GaussianMixture(3, max_iter=3, warm_start=True, **arguments)
    for _ in range(2):
        with pytest.warns(ogg_rs.ConvergenceWarning):
            parts.fit(x)
    np.testing.assert_allclose(parts.means_, whole.means_, rtol=1e-12)


def test_means_alone_take_the_rest_from_their_nearest_samples():
    x = np.array([[0.0], [1.0], [10.0], [12.0], [14.0]])
    with pytest.warns(ogg_rs.ConvergenceWarning):
        fit = ogg_rs.GaussianMixture(2, means_init=[[0.5], [12.0]], max_iter=1, reg_covar=0.0).fit(x)
    # Between the groups lie more than six deviations of either: one step moves their moments by less than 1e-9.
    np.testing.assert_allclose(fit.weights_, [0.4, 0.6], atol=1e-9)
    np.testing.assert_allclose(fit.covariances_.ravel(), [0.25, 8 / 3], atol=1e-7)


def test_clone_copy_and_pickle():
    x = data()
    fit = ogg_rs.GaussianMixture(3, random_state=1, max_iter=500).fit(x)
    fresh = clone(fit)
    assert fresh.get_params() == fit.get_params()
    assert not hasattr(fresh, "means_")
    for twin in (pickle.loads(pickle.dumps(fit)), copy.deepcopy(fit)):
        np.testing.assert_array_equal(twin.score_samples(x), fit.score_samples(x))
    with pytest.raises(ogg_rs.InvalidParameter, match="no parameter 'k'"):
        fit.set_params(k=2)


@pytest.mark.parametrize("form", [np.float32, np.int64, "fortran", "strided", "list"])
def test_any_layout_gives_the_same_numbers(form):
    x = np.round(data() * 8.0)
    want = ogg_rs.GaussianMixture(2, random_state=0, max_iter=500).fit(x).means_
    if form == "fortran":
        given = np.asfortranarray(x)
    elif form == "strided":
        given = np.repeat(x, 2, axis=1)[:, ::2]
    else:
        given = x.tolist() if form == "list" else x.astype(form)
    np.testing.assert_array_equal(ogg_rs.GaussianMixture(2, random_state=0, max_iter=500).fit(given).means_, want)


def test_a_contiguous_input_reaches_the_native_half_uncopied(monkeypatch):
    from ogg_rs import _native

    seen = []
    fit_mixture = _native.fit_mixture
    monkeypatch.setattr(_native, "fit_mixture", lambda x, **rest: seen.append(x) or fit_mixture(x, **rest))
    x = data()
    ogg_rs.GaussianMixture().fit(x)
    assert seen[0] is x


@pytest.mark.parametrize(
    "wrong",
    [{"n_components": 0}, {"n_components": 1.5}, {"covariance_type": "round"}, {"tol": -1.0}, {"reg_covar": np.nan},
     {"max_iter": 0}, {"n_init": 0}, {"init_params": "luck"}, {"random_state": "seed"}, {"weights_init": [0.5]},
     {"means_init": [[0.0]]}, {"means_init": np.zeros((1, 3)), "weights_init": [0.5]}],
)  # fmt: skip
def test_parameters_out_of_their_domain_are_refused(wrong):
    with pytest.raises(ogg_rs.InvalidParameter):
        ogg_rs.GaussianMixture(**wrong).fit(data())


def test_scikit_learn_warns_where_we_do():
    x = data()
    with pytest.warns(SklearnConvergenceWarning):
        Reference(3, max_iter=1, **start("full", x)).fit(x)
    with pytest.warns(ogg_rs.ConvergenceWarning, match="max_iter=1"):
        ogg_rs.GaussianMixture(3, max_iter=1, **start("full", x)).fit(x)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n_init", [1, 3])
def test_a_random_start_is_that_of_scikit_learn_from_the_same_seed(kind, n_init):
    x = data()
    arguments = {"covariance_type": kind, "init_params": "random", "random_state": 7, "max_iter": 1000, "n_init": n_init}
    ours, theirs = ogg_rs.GaussianMixture(2, **arguments).fit(x), Reference(2, **arguments).fit(x)
    assert ours.n_iter_ == theirs.n_iter_
    np.testing.assert_allclose(ours.means_, theirs.means_, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(ours.covariances_, theirs.covariances_, rtol=1e-6, atol=1e-7)


def test_any_one_of_the_starts_may_be_given_alone():
    x = data()
    whole = start("full", x)
    for name, value in whole.items():
        fit = ogg_rs.GaussianMixture(3, max_iter=1000, random_state=0, **{name: value}).fit(x)
        assert fit.converged_
    # Equal precisions of one component: EM from them is EM from the sample's mean.
    with pytest.warns(ogg_rs.ConvergenceWarning):
        one = ogg_rs.GaussianMixture(1, max_iter=1, precisions_init=[np.eye(3)]).fit(x)
    np.testing.assert_allclose(one.means_[0], x.mean(axis=0), rtol=1e-9)


def test_missing_values_and_weights_go_together():
    rng = np.random.default_rng(3)
    x = data(80)
    x[rng.random(x.shape) < 0.15] = np.nan
    weights = rng.integers(1, 4, 80).astype(float)
    arguments = {"max_iter": 2000, "random_state": 0, **{k: v for k, v in start("full", data(80)).items()}}
    weighted = ogg_rs.GaussianMixture(3, **arguments).fit(x, sample_weight=weights)
    repeated = ogg_rs.GaussianMixture(3, **arguments).fit(np.repeat(x, weights.astype(int), axis=0))
    np.testing.assert_allclose(weighted.means_, repeated.means_, rtol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_the_density_of_what_was_seen_is_that_of_the_marginal(kind):
    x = data(60)
    fit = ogg_rs.GaussianMixture(3, covariance_type=kind, random_state=0, max_iter=500).fit(x)
    holes = x.copy()
    holes[::2, 1], holes[::5] = np.nan, np.nan
    holes[1::5, [0, 2]] = np.nan
    full = np.stack([np.linalg.inv(p @ p.T) for p in np.broadcast_to(fit.precisions_cholesky_, (3, 3, 3))]) if kind in ("full", "tied") else np.stack([np.eye(3) * c for c in fit.covariances_])
    for row, density, shares, label in zip(holes, fit.score_samples(holes), fit.predict_proba(holes), fit.predict(holes), strict=True):
        seen = ~np.isnan(row)
        parts = []
        for weight, mean, covariance in zip(fit.weights_, fit.means_, full, strict=True):
            block, away = covariance[np.ix_(seen, seen)], row[seen] - mean[seen]
            square = away @ np.linalg.solve(block, away) if seen.any() else 0.0
            norm = np.linalg.det(2 * np.pi * block) if seen.any() else 1.0
            parts.append(weight * np.exp(-0.5 * square) / np.sqrt(norm))
        assert density == pytest.approx(np.log(np.sum(parts)), abs=1e-9)
        np.testing.assert_allclose(shares, parts / np.sum(parts), atol=1e-9)
        assert label == np.argmax(parts)
    assert np.isfinite([fit.bic(holes), fit.aic(holes), fit.score(holes)]).all()


@pytest.mark.parametrize("criterion", ["bic", "aic"])
def test_the_chosen_order_has_the_lowest_criterion(criterion):
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(size=(80, 2)) + c for c in ([0, 0], [12, 0], [0, 12])])
    fit = ogg_rs.GaussianMixture(n_init=3, random_state=0, max_iter=500).select_order(x, k_max=6, criterion=criterion)
    assert fit.order_criteria_.shape == (6,)
    assert fit.n_components == int(np.nanargmin(fit.order_criteria_)) + 1
    assert getattr(fit, criterion)(x) == pytest.approx(fit.order_criteria_[fit.n_components - 1], rel=1e-6)
    if criterion == "bic":
        assert fit.n_components == 3
    for wrong in ({"k_max": 0}, {"k_min": 3, "k_max": 2}, {"criterion": "luck"}):
        with pytest.raises(ogg_rs.InvalidParameter):
            fit.select_order(x, **wrong)
    with pytest.raises(ogg_rs.InvalidParameter, match="means_init"):
        ogg_rs.GaussianMixture(means_init=[[0.0, 0.0]]).select_order(x)


def fused_step(x, fit, errors):
    """Equations (11) to (14) after one M step from `fit`, written down."""
    shares = fit.predict_proba(x)
    weights = shares.mean(axis=0)
    reliability = (shares * errors[:, None]).sum(axis=0) / shares.sum(axis=0)
    support = np.exp(-np.abs(reliability[:, None] - reliability[None]))
    agreement = (support.sum(axis=1) - 1.0) / (len(weights) - 1)
    omega = agreement / agreement.sum()
    return reliability, omega, omega * weights / (omega * weights).sum()


def test_weight_fusion_is_equations_11_to_14():
    x = data()
    errors = np.abs(np.random.default_rng(1).normal(size=len(x))) * (1.0 + (x[:, 0] > 0))
    begin = start("full", x)
    fusion = ogg_rs.WeightFusion(errors=errors)
    with pytest.warns(ogg_rs.ConvergenceWarning):
        fused = ogg_rs.GaussianMixture(3, max_iter=1, weight_fusion=fusion, **begin).fit(x)
    begun = ogg_rs.GaussianMixture(3, **begin)
    given = tuple(begin[name] for name in ("weights_init", "means_init", "precisions_init"))
    begun._take(start_mixture(x, 3, "full", 1e-6, given, None))
    begun.n_features_in_ = 3
    reliability, omega, weights = fused_step(x, begun, errors)
    np.testing.assert_allclose(fused.fusion_reliability_[-1], reliability, rtol=1e-9)
    np.testing.assert_allclose(fused.fusion_omega_[-1], omega, rtol=1e-9)
    np.testing.assert_allclose(fused.weights_, weights, rtol=1e-9)


def test_the_literal_reading_changes_nothing():
    x = np.cumsum(data(120), axis=0) * 0.1
    arguments = {"max_iter": 500, "random_state": 0}
    plain = ogg_rs.GaussianMixture(2, **arguments).fit(x)
    literal = ogg_rs.GaussianMixture(2, weight_fusion="literal", **arguments).fit(x)
    np.testing.assert_allclose(literal.means_, plain.means_, rtol=1e-6)
    np.testing.assert_allclose(literal.fusion_omega_, 0.5)
    assert not hasattr(plain, "fusion_omega_")
    parts = ogg_rs.WeightFusion(order=(1, 1, 0), lengths=[60, 60])
    fused = ogg_rs.GaussianMixture(2, weight_fusion=parts, **arguments).fit(x)
    assert fused.fusion_omega_.shape[1] == 2
    assert clone(fused).weight_fusion == parts


@pytest.mark.parametrize(
    "wrong",
    ["luck", 3, ogg_rs.WeightFusion(reading="other"), ogg_rs.WeightFusion(errors=[1.0]), ogg_rs.WeightFusion(order=(1, 0)),
     ogg_rs.WeightFusion(lengths=[3]), ogg_rs.WeightFusion(errors=[-1.0] * 400)],
)  # fmt: skip
def test_fusion_that_does_not_fit_is_refused(wrong):
    with pytest.raises(ogg_rs.InvalidParameter):
        ogg_rs.GaussianMixture(2, weight_fusion=wrong).fit(data())


def test_a_covariance_that_is_singular_to_rounding_is_a_numerical_error_and_leaves_the_last_fit(monkeypatch):
    singular = np.array([[[1.0, 1.0], [1.0, 1.0 - 1e-15]]])
    with pytest.raises(ogg_rs.NumericalError, match=r"covariances_: expected positive definite ones, .* larger reg_covar") as error:
        precision_factors("full", singular)
    assert error.value.kind == "NotPositiveDefinite"
    x = np.random.default_rng(1).normal(size=(50, 2))
    mixture = ogg_rs.GaussianMixture(2, random_state=0).fit(x)
    before = (mixture.means_.copy(), mixture.covariances_.copy(), mixture.score(x), mixture.n_iter_, mixture.converged_)

    def fails(kind, covariances):
        return precision_factors("full", singular)

    monkeypatch.setattr("ogg_rs._fit.precision_factors", fails)
    with pytest.raises(ogg_rs.NumericalError):
        mixture.fit(x + 5)
    assert np.array_equal(mixture.means_, before[0])
    assert np.array_equal(mixture.covariances_, before[1])
    assert (mixture.score(x), mixture.n_iter_, mixture.converged_) == before[2:]
