"""Peers of the capture benchmark: PyAV on one thread and OpenCV as it comes, on the same clips. Prints the same rows."""

import json
import os
import pathlib
import statistics
import time

import av
import cv2

BUDGET_S = 3.0


def pyav(path: pathlib.Path) -> int:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_count = 1
        return sum(1 for frame in container.decode(stream) if frame.to_ndarray(format="rgb24").size)


def opencv(path: pathlib.Path) -> int:
    capture = cv2.VideoCapture(str(path))
    frames = 0
    while True:
        ok, bgr = capture.read()
        if not ok:
            return frames
        cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
        frames += 1


def measure(name: str, peer: str, path: pathlib.Path, decode, note: str) -> dict:
    times, start = [], time.perf_counter()
    while time.perf_counter() - start < BUDGET_S or not times:
        begin = time.perf_counter()
        frames = decode(path)
        times.append((time.perf_counter() - begin) * 1e3 / max(frames, 1))
    return {"name": name, "unit": "ms/frame", "peer": statistics.median(times), "peer_name": peer, "note": note}


clips = [("decode 720p H.264", pathlib.Path(__file__).parent / "data" / "testsrc2-720p.mp4")]
extra = [pathlib.Path(p) for p in os.environ.get("OGG_BENCH_VIDEO", "").split(os.pathsep) if p]
clips += [(f"decode {path.name}", path) for path in extra]
rows = []
for name, path in clips:
    rows.append(measure(name, "PyAV", path, pyav, "one thread"))
    rows.append(measure(name, "OpenCV", path, opencv, f"ffmpeg threads on {os.cpu_count()} cores"))
print(json.dumps({"area": "capture", "rows": rows}))
