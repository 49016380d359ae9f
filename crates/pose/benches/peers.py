"""The same work with NumPy, OpenCV and ONNX Runtime's own Python interface. Prints the same rows; see pose.rs.

NumPy's encoder and fusion are vectorised over pictures, joints and cells, compute in float32 and write into arrays that
are allocated once. NumPy uses one thread; the crate uses OGG_POSE_THREADS.
"""

import json
import os
import pathlib
import time

import numpy as np

LIMBS = [(1, 8), (8, 9), (9, 10), (1, 11), (11, 12), (12, 13), (1, 2), (2, 3), (3, 4), (2, 16), (1, 5), (5, 6), (6, 7),
         (5, 17), (1, 0), (0, 14), (0, 15), (14, 16), (15, 17)]
THREADS = int(os.environ.get("OGG_POSE_THREADS", "2"))


def row(name, peer, n, call):
    for _ in range((n + 9) // 10):
        call()
    times = []
    processor = time.process_time()
    for _ in range(n):
        start = time.perf_counter()
        call()
        times.append((time.perf_counter() - start) * 1e3)
    processor = (time.process_time() - processor) / n * 1e3
    times.sort()
    return {"name": name, "unit": "ms", "peer": times[len(times) // 2], "peer_processor": processor, "peer_name": peer, "n": n}


def labels(batch, people):
    i = np.arange(batch * people * 36)
    return ((i * 7919 % 3680) / 10).astype(np.float32).reshape(batch, people, 18, 2)


def blank(batch, size=368, stride=8):
    cells = size // stride
    kinds = (19, np.float32), (2 * len(LIMBS), np.float32), (19, np.bool_), (2 * len(LIMBS), np.bool_)
    return [np.empty((batch, channels, cells, cells), dtype) for channels, dtype in kinds]


def encode(joints, maps, stride=8, sigma=7.0, half=8.0):
    pcm, paf, pcm_mask, paf_mask = maps
    batch, people, cells = len(joints), joints.shape[1], pcm.shape[2]
    c = ((np.arange(cells) + 0.5) * stride - 0.5).astype(np.float32)
    gx = np.exp(-((c - joints[..., 0, None]) ** 2) / np.float32(2 * sigma**2))
    gy = np.exp(-((c - joints[..., 1, None]) ** 2) / np.float32(2 * sigma**2))
    parts, background = pcm[:, :-1], pcm[:, -1]
    np.multiply(gy[:, 0, :, :, None], gx[:, 0, :, None, :], out=parts)
    for p in range(1, people):
        np.maximum(parts, gy[:, p, :, :, None] * gx[:, p, :, None, :], out=parts)
    np.max(parts, axis=1, out=background)
    np.subtract(1, background, out=background)
    pcm_mask.fill(True)
    paf_mask.fill(True)
    paf.fill(0)
    field = paf.reshape(batch, len(LIMBS), 2, cells, cells)
    ends = np.array(LIMBS)
    a, b = joints[:, :, ends[:, 0]], joints[:, :, ends[:, 1]]
    along = b - a
    length = np.sqrt((along**2).sum(-1))
    unit = along / np.maximum(length, np.float32(1e-3))[..., None]
    dx, dy = c - a[..., 0, None], c - a[..., 1, None]
    ux, uy = unit[..., 0, None], unit[..., 1, None]
    xx, xy, yx, yy = dx * ux, dx * uy, dy * ux, dy * uy
    count = np.zeros((batch, len(LIMBS), cells, cells), np.float32)
    for p in range(people):
        forward = xx[:, p, :, None, :] + yy[:, p, :, :, None]
        sideways = xy[:, p, :, None, :] - yx[:, p, :, :, None]
        on = (forward >= 0) & (forward <= length[:, p, :, None, None]) & (np.abs(sideways, out=sideways) <= half)
        field[:, :, 0] += on * ux[:, p, :, :, None]
        field[:, :, 1] += on * uy[:, p, :, :, None]
        count += on
    if people > 1:
        np.divide(field, count[:, :, None], out=field, where=(count > 1)[:, :, None])


def noise(shape):
    return ((np.arange(np.prod(shape)) * 7919 % 1000) / 833 - 0.2).astype(np.float32).reshape(shape)


def fuse(maps, pcm_t, paf_t, floor=0.1):
    pcm, paf, pcm_mask, paf_mask = maps
    parts, background = pcm[:, :-1], pcm[:, -1]
    np.maximum(parts, np.clip(pcm_t[:, :-1], 0, 1), out=parts)
    np.max(parts, axis=1, out=background)
    np.subtract(1, background, out=background)
    answered = pcm_t[:, :-1] >= floor
    pcm_mask[:, :-1] |= answered
    pcm_mask[:, -1] |= answered.any(1)
    pair = (len(paf), -1, 2, *paf.shape[2:])
    own, other, mask = (f.reshape(pair) for f in (paf, paf_t, paf_mask))
    n_own, n_other = (f[:, :, 0] ** 2 + f[:, :, 1] ** 2 for f in (own, other))
    np.copyto(own, other, where=(n_own <= n_other)[:, :, None])
    mask |= (n_other >= floor**2)[:, :, None]


def targets(rows):
    """Arrays are allocated once; the whole batch at once, or a picture after the other, whichever is faster."""
    joints = labels(16, 2)
    maps = blank(16)
    teacher = noise(maps[0].shape), noise(maps[1].shape)

    def pictures():
        for i in range(16):
            yield slice(i, i + 1), [m[i:i + 1] for m in maps]

    def one_by_one(both, first):
        for i, part in pictures():
            if first:
                encode(joints[i], part)
            if both or not first:
                fuse(part, teacher[0][i], teacher[1][i])

    whole = {
        "encode": lambda: encode(joints, maps),
        "fuse": lambda: fuse(maps, *teacher),
        "encode and fuse": lambda: (encode(joints, maps), fuse(maps, *teacher)),
    }
    single = {
        "encode": lambda: one_by_one(False, True),
        "fuse": lambda: one_by_one(False, False),
        "encode and fuse": lambda: one_by_one(True, True),
    }
    for what, of in (("encode", ", 2 people"), ("fuse", ""), ("encode and fuse", ", 2 people")):
        name = f"targets: {what} 16 pictures of 368x368{of}"
        ways = {"the batch at once": whole[what], "picture by picture": single[what]}
        measured = [(row(name, f"NumPy, 1 thread, {way}", 30, call)) for way, call in ways.items()]
        rows.append(min(measured, key=lambda r: r["peer"]))


def networks(rows):
    import onnxruntime

    folder = os.environ.get("OGG_POSE_MODELS")
    if not folder:
        return
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = THREADS
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    for path in sorted(pathlib.Path(folder).glob("*.onnx")):
        session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        (spec,) = session.get_inputs()
        shape = [n if isinstance(n, int) else d for n, d in zip(spec.shape, (1, 296, 528, 3))]
        tensor = np.full(shape, 100, np.int32 if "int32" in spec.type else np.float32)
        rows.append(row(f"network: {path.stem} on ONNX Runtime", "onnxruntime from Python, the network alone", 100,
                        lambda: session.run(None, {spec.name: tensor})))


def main():
    rows = []
    targets(rows)

    import cv2

    cv2.setNumThreads(1)
    picture = ((np.arange(1280 * 720 * 3) * 7919) >> 4).astype(np.uint8).reshape(720, 1280, 3)

    def letterbox(size, planar):
        scale = max(1280, 720) / size
        w, h = round(1280 / scale), round(720 / scale)
        out = np.zeros((size, size, 3), np.uint8)
        top, left = (size - h) // 2, (size - w) // 2
        out[top:top + h, left:left + w] = cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA)
        tensor = out.astype(np.float32) * np.float32(1 / 255)
        return np.ascontiguousarray(tensor.transpose(2, 0, 1)) if planar else tensor

    rows.append(row("preprocess: 1280x720 letterboxed to 256x256 float", "OpenCV INTER_AREA + NumPy", 200,
                    lambda: letterbox(256, False)))
    rows.append(row("preprocess: 1280x720 letterboxed to 368x368 float planar", "OpenCV INTER_AREA + NumPy", 200,
                    lambda: letterbox(368, True)))
    networks(rows)
    print(json.dumps({"area": "pose", "rows": rows}))


main()
