"""Times scikit-learn, gmr, statsmodels and statsforecast on the data of gmr.rs; prints one JSON document.

Every row runs on one thread except the large EM, which gets two as ours does.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(name, "2")

import json
import statistics
import time
import warnings

import gmr
import numpy as np
from sklearn.mixture import GaussianMixture
from statsforecast.models import ARIMA as StatsforecastArima
from statsmodels.tsa.arima.model import ARIMA
from threadpoolctl import threadpool_limits

warnings.filterwarnings("ignore")
np.seterr(over="ignore")
rows = []


def uniform(counter):
    z = (np.asarray(counter, np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(11)).astype(float) * 2.0**-53


def normal(index):
    index = np.asarray(index, np.uint64)
    total = np.zeros(index.shape)
    for i in range(12):
        total = total + uniform(index * np.uint64(12) + np.uint64(i))
    return total - 6.0


def motion(n):
    i = np.arange(n)
    t = (i % 200) * 0.005
    columns = [t]
    for j in range(6):
        value = (0.1 + 0.05 * j) * np.sin(2 * np.pi * (0.7 + 0.3 * j) * t + j)
        columns.append(value + 0.01 * normal(i * 6 + j))
    return np.column_stack(columns)


def centres(k):
    return 4.0 * uniform(1_000_000_007 + np.arange(k * 7)).reshape(k, 7)


def clusters(n, k):
    i = np.arange(n)
    mean, previous, columns = centres(k), np.zeros(n), []
    for j in range(7):
        z = normal(i * 7 + j) + 0.5 * previous
        columns.append(mean[i % k, j] + (0.5 + 0.1 * j) * z)
        previous = z
    return np.column_stack(columns)


def arima_series():
    noise = normal(50_000_017 + np.arange(1100))
    w = np.zeros(1100)
    for t in range(2, 1100):
        w[t] = 0.6 * w[t - 1] - 0.2 * w[t - 2] + noise[t] + 0.4 * noise[t - 1]
    return np.cumsum(w[100:])


def measure(names, unit, scale, peer, repetitions, run, note, warm=True):
    if warm:
        run()
    seconds, processor = [], []
    for _ in range(repetitions):
        begin, before = time.perf_counter(), time.process_time()
        result = run()
        seconds.append(time.perf_counter() - begin)
        processor.append(time.process_time() - before)
    for name in names:
        rows.append({
            "name": name, "unit": unit, "peer": statistics.median(seconds) * scale, "peer_name": peer,
            "min": min(seconds) * scale, "max": max(seconds) * scale, "n": repetitions, "note": note(result),
            "peer_processor": statistics.median(processor) * scale,
        })


def main():
    with threadpool_limits(1):
        x = motion(1000)
        for k in (5, 10):
            # As in ours, each repetition has its own start.
            models = []

            def fit(k=k, models=models):
                models.append(GaussianMixture(k, random_state=len(models), max_iter=500).fit(x))

            measure(
                [f"gmm_fit_1000x7_k{k}"], "ms", 1e3, "scikit-learn", 60, fit,
                lambda _, models=models: (
                    f"one thread; {len(models)} seeds; mean of {np.mean([m.n_iter_ for m in models]):.1f} EM iterations, "
                    f"log-likelihood {np.mean([m.score(x) for m in models]):.4f}"
                ),
            )
        model = GaussianMixture(10, random_state=0, max_iter=500).fit(x)
        mixture = gmr.GMM(10, priors=model.weights_, means=model.means_, covariances=model.covariances_)
        queries = (np.arange(200) * 0.005)[:, None]
        measure(
            ["gmr_200_queries_k10_mean_and_covariance"], "us", 1e6, "gmr condition + to_mvn", 5,
            lambda: [mixture.condition(np.array([0]), q).to_mvn() for q in queries], lambda _: "one thread",
        )
        measure(
            ["gmr_200_queries_k10_mean_and_covariance_against_mean_only", "gmr_200_queries_k10_mean"], "us", 1e6,
            "gmr predict", 15,
            lambda: mixture.predict(np.array([0]), queries), lambda _: "one thread, mean only",
        )
        y = arima_series()
        measure(
            ["arima_211_n1000_against_statsmodels"], "ms", 1e3, "statsmodels", 7,
            lambda: ARIMA(y, order=(2, 1, 1)).fit(), lambda m: f"one thread; log-likelihood {m.llf:.6f}",
        )
        measure(
            ["arima_211_n1000_against_statsforecast"], "ms", 1e3, "statsforecast", 15,
            lambda: StatsforecastArima(order=(2, 1, 1), method="CSS-ML").fit(y),
            lambda m: f"one thread; log-likelihood {m.model_['loglik']:.6f}",
        )
    k = 16
    x = clusters(200_000, k)
    shift = 0.3 * (uniform(2_000_000_011 + np.arange(k * 7)).reshape(k, 7) - 0.5)
    start = dict(weights_init=np.full(k, 1 / k), means_init=centres(k) + shift, precisions_init=np.stack([np.eye(7)] * k))
    with threadpool_limits(2):
        measure(
            ["em_10_steps_200000x7_k16"], "ms", 1e3, "scikit-learn", 2,
            lambda: GaussianMixture(k, max_iter=10, tol=0.0, **start).fit(x),
            lambda m: f"two threads; {m.n_iter_} iterations, mean log-likelihood before step 10: {m.lower_bound_:.9f}",
            warm=False,
        )
    print(json.dumps({"area": "gmr", "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
