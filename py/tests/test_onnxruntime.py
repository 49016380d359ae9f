"""The estimator on ONNX Runtime, in processes of their own: a process holds one runtime."""

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest

pytestmark = pytest.mark.skipif(find_spec("onnxruntime") is None, reason="onnxruntime is not installed")

LOOK = """
import json, sys
import numpy as np
from ogg_rs import pose, sim
estimator = pose.Estimator("builtin:ogg-lite", onnxruntime={runtime})
frame = sim.Scene(sim.Worker(seed=5), size=(320, 240)).render(1.0)
print(json.dumps([estimator.runtime, estimator.estimate(frame.image).keypoints[0].tolist()]))
"""

RUN_OFTEN = """
import json
import numpy as np
from ogg_rs import pose
def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6
estimator = pose.Estimator("builtin:ogg-lite", threads=1)
pictures = np.random.default_rng(0).integers(0, 255, (7, 480, 640, 3), np.uint8)
held = []
for turn in range(400):
    estimator.estimate(pictures[turn % 7])
    if turn in (99, 399):
        held.append(resident_mb())
print(json.dumps([estimator.runtime, held]))
"""


def answer_of(code: str) -> list:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_both_runtimes_see_the_same_worker():
    name, theirs = answer_of(LOOK.format(runtime=None))
    assert name.startswith("ONNX Runtime"), name
    _, ours = answer_of(LOOK.format(runtime='"tract"'))
    seen = [(a, b) for a, b in zip(theirs, ours, strict=True) if a[2] > 0 or b[2] > 0]
    assert len(seen) >= 6
    for a, b in seen:
        assert a == pytest.approx(b, abs=0.02)


@pytest.mark.skipif(sys.platform != "linux", reason="resident memory is read from /proc")
def test_memory_does_not_grow_with_the_number_of_pictures():
    name, (early, late) = answer_of(RUN_OFTEN)
    assert name.startswith("ONNX Runtime"), name
    assert late - early < 30, f"{early:.0f} MB after 100 pictures, {late:.0f} MB after 400"
