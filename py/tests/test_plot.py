"""Every picture shows the numbers it is made of."""

import matplotlib

matplotlib.use("Agg")
import numpy as np
import pytest
from matplotlib import pyplot as plt

import ogg_rs
from ogg_rs import plot, recording


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_tracks_and_errors_of_a_run(builtin_run):
    run = recording.open(builtin_run[0])
    table = run.table("joint_states")
    ax = plot.tracks(table)
    assert [line.get_label() for line in ax.lines] == [f"joint{i}" for i in range(1, 7)]
    np.testing.assert_array_equal(ax.lines[2].get_ydata(), table["joint3.position"])
    errors = plot.tracking_error(run)
    assert len(errors.lines) == 6 and all(np.abs(line.get_ydata()).max() < 0.2 for line in errors.lines)
    with pytest.raises(ogg_rs.InvalidParameter, match="quantity"):
        plot.tracks(table, "colour")


def test_a_band_is_as_wide_as_the_variance_says():
    t = np.arange(4.0)
    ax = plot.variance_band(t, t, t, deviations=3.0)
    outline = ax.collections[0].get_paths()[0].vertices
    for x in t:
        assert outline[outline[:, 0] == x, 1].max() == pytest.approx(x + 3.0 * np.sqrt(x))
    with pytest.raises(ogg_rs.InvalidParameter, match="negative"):
        plot.variance_band(t, t, -t)


@pytest.mark.parametrize("kind", ["full", "tied", "diag", "spherical"])
def test_an_ellipse_is_the_contour_of_its_component(kind):
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(size=(200, 3)), rng.normal(size=(200, 3)) + 6.0])
    fit = ogg_rs.GaussianMixture(2, covariance_type=kind, random_state=0).fit(x)
    ax = plot.components(fit, (2, 0), samples=x, deviations=1.5)
    full = {
        "full": lambda: fit.covariances_[0],
        "tied": lambda: fit.covariances_,
        "diag": lambda: np.diag(fit.covariances_[0]),
        "spherical": lambda: np.eye(3) * fit.covariances_[0],
    }[kind]()
    block = np.linalg.inv(full[np.ix_([2, 0], [2, 0])])
    away = np.stack(ax.lines[1].get_data()) - fit.means_[0, [2, 0], None]
    np.testing.assert_allclose(np.einsum("in,ij,jn->n", away, block, away), 1.5**2, rtol=1e-9)
    with pytest.raises(ogg_rs.InvalidParameter):
        plot.components(fit, (0, 3))
    with pytest.raises(ogg_rs.NotFitted):
        plot.components(ogg_rs.GaussianMixture())


def test_a_motion_model_has_three_bands(builtin_run):
    model = ogg_rs.MotionModel.teach([recording.open(builtin_run[0]).arm()])
    ax = plot.motion_model(model)
    assert len(ax.lines) == len(ax.collections) == 3


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)
    with pytest.raises(ogg_rs.MissingDependency, match=r"ogg_rs\[plot\]"):
        plot.variance_band([0.0], [0.0], [0.0])
