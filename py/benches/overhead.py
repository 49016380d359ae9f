"""What a small call from Python costs over the work it asks for: `cargo xtask bench python`.

`GaussianMixture.predict` of one row is timed from Python, and the same work, repeated in Rust without the border, beside
it: their difference is the overhead of argument checks, border and result array. Of the other calls the whole time is
shown. Prints one JSON document, microseconds: median, least and 99th percentile over rounds.
"""

import json
import platform
import time

import numpy as np

import ogg_rs
from ogg_rs import kin

REPEATS, ROUNDS, ROWS = 300, 100, 4096


def median_us(call, repeats):
    """Median and quartiles over rounds of the mean time of a call, microseconds."""
    rounds = []
    for _ in range(ROUNDS):
        begin = time.perf_counter_ns()
        for _ in range(repeats):
            call()
        rounds.append((time.perf_counter_ns() - begin) / repeats / 1e3)
    return np.quantile(rounds, [0.5, 0.0, 0.99])


def row(name, middle, least, most, note):
    found = {"ours": middle, "min": least, "p99": most}
    return {"name": name, "unit": "us", **{k: round(float(v), 3) for k, v in found.items()}, "n": REPEATS * ROUNDS, "note": note}


def main():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(ROWS, 7))
    mixture = ogg_rs.GaussianMixture(5, random_state=0, max_iter=1000).fit(x)
    regressor = ogg_rs.GaussianMixtureRegressor(5, random_state=0, max_iter=1000).fit(x[:, :1], x[:, 1:])
    robot, q = kin.Robot.builtin(), rng.uniform(-1.0, 1.0, (ROWS, 6))
    one = x[:1]
    rust_us = float(np.median([mixture._mixture.labels_seconds(one, 2000) * 1e6 for _ in range(ROUNDS)]))
    whole = median_us(lambda: mixture.predict(one), REPEATS)
    note = f"Python {platform.python_version()}, whole call {whole[0]:.2f} us, of it in Rust {rust_us:.2f} us"
    cases = {
        "GaussianMixture.score_samples": (mixture.score_samples, x),
        "GaussianMixtureRegressor.predict": (regressor.predict, np.ascontiguousarray(x[:, :1])),
        "Robot.fk": (robot.fk, q),
    }
    rows = [row("overhead of GaussianMixture.predict", *(whole - rust_us), note)]
    for name, (call, data) in cases.items():
        one = data[:1]
        rows.append(row(f"{name}, one row", *median_us(lambda call=call, one=one: call(one), REPEATS), "whole call"))
    print(json.dumps({"area": "python", "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
