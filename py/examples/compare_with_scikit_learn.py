"""Fits the same mixture from the same start here and in scikit-learn, and compares numbers and times."""

import time

import numpy as np
from sklearn.mixture import GaussianMixture as Reference

import ogg_rs


def main() -> None:
    rng = np.random.default_rng(0)
    centres = 2.0 * rng.normal(size=(5, 7))
    x = centres[rng.integers(5, size=20_000)] + rng.normal(size=(20_000, 7))
    start = {"means_init": centres, "weights_init": np.full(5, 0.2), "precisions_init": np.stack([np.eye(7)] * 5)}

    def timed(estimator):
        begin = time.perf_counter()
        return estimator.fit(x), time.perf_counter() - begin

    ours, our_s = timed(ogg_rs.GaussianMixture(5, tol=1e-6, max_iter=200, **start))
    theirs, their_s = timed(Reference(5, tol=1e-6, max_iter=200, **start))
    difference = np.abs(ours.means_ - theirs.means_).max()
    print(f"iterations          {ours.n_iter_} and {theirs.n_iter_}")
    print(f"mean log-likelihood {ours.score(x):.9f} and {theirs.score(x):.9f}")
    print(f"means differ by     {difference:.2e} at most")
    print(f"time                {our_s * 1e3:.0f} ms and {their_s * 1e3:.0f} ms")
    # What scikit-learn does not do: values that were not seen, and a condition on some columns.
    x[::3, 2] = np.nan
    model = ogg_rs.GaussianMixture(5, max_iter=500, **start).fit(x)
    given = model.condition([0, 1], x[1, :2])
    print(f"given two columns   {given.weights_.round(3).tolist()} are the weights of the other five")


if __name__ == "__main__":
    main()
