"""Long work runs without the interpreter, so that two fits are under way at once; inputs are not copied."""

import subprocess
import sys
import textwrap
import threading
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ogg_rs
from ogg_rs import kin, pose


def run(code):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_two_fits_are_under_way_at_once():
    """Each of two threads fits in one native call of one rayon thread. The processor time of both calls can overlap
    only if neither holds the interpreter: were it held, the second call would begin after the first had ended."""
    begun, ended = run(
        """
        import os, threading, time, warnings
        os.environ["RAYON_NUM_THREADS"] = "1"
        import numpy as np, ogg_rs
        warnings.simplefilter("ignore")
        rng = np.random.default_rng(0)
        x = rng.normal(size=(60_000, 6))
        gate = threading.Barrier(2)
        spans = []
        def fit():
            model = ogg_rs.GaussianMixture(6, tol=0.0, max_iter=40, random_state=0)
            gate.wait()
            begin = time.monotonic()
            model.fit(x)
            spans.append((begin, time.monotonic()))
        threads = [threading.Thread(target=fit) for _ in range(2)]
        [t.start() for t in threads]
        [t.join() for t in threads]
        print(max(b for b, _ in spans), min(e for _, e in spans))
        """
    )
    assert float(begun) < float(ended)


WORK = {
    "mixture": lambda: ogg_rs.GaussianMixture(6, tol=0.0, max_iter=25, random_state=0).fit(X),
    "regressor": lambda: REGRESSOR.predict(MANY, return_cov=True),
    "kinematics": lambda: ROBOT.ik(POSES),
    "targets": lambda: pose.encode_targets(JOINTS, STATES, BOXES, size=(368, 368)),
}
X = np.random.default_rng(0).normal(size=(30_000, 6))
MANY = np.random.default_rng(3).normal(size=(400_000, 3))
ROBOT = kin.Robot.builtin()
POSES = ROBOT.fk(np.random.default_rng(1).uniform(-1.0, 1.0, (4_000, 6)))
JOINTS = np.random.default_rng(2).uniform(0, 368, (120, 4, 18, 2)).astype(np.float32)
STATES = np.full((120, 4, 18), 3, np.uint8)
BOXES = np.zeros((120, 4, 4), np.float32)
REGRESSOR = ogg_rs.GaussianMixtureRegressor(4, random_state=0, max_iter=500).fit(X[:2000, :3], X[:2000, 3:])


@pytest.mark.filterwarnings("ignore::ogg_rs.ConvergenceWarning")
@pytest.mark.parametrize("name", WORK)
def test_python_goes_on_while_native_code_works(name):
    """A call that held the interpreter would let no other thread run between its first and its last instruction. All of `WORK`
    takes tens of milliseconds, so that another thread gets its turn on a busy machine too."""
    counted, running = [], threading.Event()

    def count():
        running.set()
        while running.is_set():
            counted.append(time.monotonic())
            # Hands the interpreter over.
            time.sleep(0)

    other = threading.Thread(target=count)
    other.start()
    running.wait()
    begin = time.monotonic()
    WORK[name]()
    end = time.monotonic()
    running.clear()
    other.join()
    # Python code before and after the native call takes a few milliseconds at most: look at the middle.
    inside = [t for t in counted if begin + 0.3 * (end - begin) < t < begin + 0.7 * (end - begin)]
    assert len(inside) > 3


def test_many_threads_may_share_one_fitted_model():
    fit = ogg_rs.GaussianMixture(3, random_state=0, max_iter=500).fit(X[:1000])
    want = fit.predict_proba(X)
    with ThreadPoolExecutor(4) as pool:
        for got in pool.map(lambda _: fit.predict_proba(X), range(8)):
            np.testing.assert_array_equal(got, want)


def peak_growth(call):
    """Bytes that NumPy and Python allocated at the peak of a call, over those before it."""
    call()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        kept = call()
        del kept
        return tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


@pytest.mark.filterwarnings("ignore::ogg_rs.ConvergenceWarning")
def test_contiguous_float64_is_never_copied():
    """NumPy reports its allocations to tracemalloc: a copy of the input would show as its size."""
    x = np.random.default_rng(0).normal(size=(200_000, 6))
    fit = ogg_rs.GaussianMixture(2, max_iter=2, tol=0.0, random_state=0).fit(x[:500])
    calls = {
        "fit": lambda a: ogg_rs.GaussianMixture(2, max_iter=1, tol=0.0, random_state=0).fit(a),
        "score_samples": lambda a: fit.score_samples(a),
        "predict": lambda a: fit.predict(a),
        "fk": lambda a: ROBOT.jacobian(a[:1000]),
        "arima": lambda a: ogg_rs.Arima((0, 0, 0)).loglike_at([0.0, 1.0], a.reshape(-1)),
    }
    for name, call in calls.items():
        results = {"score_samples": 8 * len(x), "predict": 8 * len(x), "fk": 8 * 36 * 1000}.get(name, 0)
        # The mask of NaN is one byte per number, an eighth of the input.
        assert peak_growth(lambda call=call: call(x)) < results + x.nbytes / 4, name
    # The judge sees a copy where one has to be made.
    assert peak_growth(lambda: fit.score_samples(np.asfortranarray(x))) > x.nbytes


def test_results_own_their_memory():
    fit = ogg_rs.GaussianMixture(2, random_state=0, max_iter=500).fit(X[:1000])
    labels, shares = fit.predict(X), fit.predict_proba(X)
    for array in (labels, shares, ROBOT.fk(np.zeros((3, 6)))):
        assert array.flags.writeable and array.flags.c_contiguous
    kept = shares.copy()
    fit.fit(X[:1000] + 1.0)
    np.testing.assert_array_equal(shares, kept)
