"""What a small call from Python costs over the work it asks for: `cargo xtask bench python`.

A call of n rows that runs in one thread takes `overhead + n * row`: what a call of one row takes beyond the row's share of
a long call is the overhead of argument checks, border and result array. `GaussianMixture.predict` hands its rows to a thread
pool; the same work, repeated in Rust without the border, is timed beside it instead. Prints one JSON document,
microseconds: median, least, 90th and 99th percentile over rounds, and the median of the processor's time, which other
work on the machine does not lengthen.
"""

import json
import platform
import time

import numpy as np

import ogg_rs
from ogg_rs import kin

REPEATS, ROUNDS, ROWS = 50, 400, 4096


def times_us(call, repeats=REPEATS, count=ROUNDS):
    """Mean time of a call in every round, and mean time of the processor, microseconds, `(2, rounds)`."""
    rounds = []
    for _ in range(count):
        begin, worked = time.perf_counter_ns(), time.process_time_ns()
        for _ in range(repeats):
            call()
        rounds.append((time.perf_counter_ns() - begin, time.process_time_ns() - worked))
    return np.array(rounds).T / repeats / 1e3


def row(name, times, note):
    wall, processor = times
    median, least, p90, p99 = (round(float(value), 3) for value in np.quantile(wall, [0.5, 0.0, 0.9, 0.99]))
    found = {"ours": median, "ours_processor": round(float(np.median(processor)), 3), "min": least, "p99": p99}
    note = f"p90 {p90:.2f}; Python {platform.python_version()}; {note}"
    return {"name": f"overhead of {name}", "unit": "us", **found, "n": REPEATS * ROUNDS, "note": note}


def main():
    rng = np.random.default_rng(0)
    x, q = rng.normal(size=(ROWS, 7)), rng.uniform(-1.0, 1.0, (ROWS, 6))
    mixture = ogg_rs.GaussianMixture(5, random_state=0, max_iter=1000).fit(x)
    regressor = ogg_rs.GaussianMixtureRegressor(5, random_state=0, max_iter=1000).fit(x[:, :1], x[:, 1:])
    cases = {
        "GaussianMixtureRegressor.predict": (regressor.predict, np.ascontiguousarray(x[:, :1])),
        "Robot.fk": (kin.Robot.builtin().fk, q),
    }
    rows = []
    for name, (call, data) in cases.items():
        one = data[:1]
        # Least against least: both are of the undisturbed machine.
        share_us = times_us(lambda call=call, data=data: call(data), 2, 50)[0].min() / ROWS
        whole = times_us(lambda call=call, one=one: call(one))
        rows.append(row(name, whole - share_us, f"one row in Rust {share_us:.2f}"))
    one = x[:1]
    rust_us = min(mixture._mixture.labels_seconds(one, REPEATS) * 1e6 for _ in range(ROUNDS))
    whole = times_us(lambda: mixture.predict(one))
    rows.append(row("GaussianMixture.predict", whole - rust_us, f"the call in Rust {rust_us:.2f}"))
    print(json.dumps({"area": "python", "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
