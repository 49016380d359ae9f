"""The same work with NumPy, OpenCV and ONNX Runtime's own Python interface. Prints the same rows; see pose.rs.

NumPy's encoder is vectorised over the batch, people and cells; it is what a PyTorch data loader would do.
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
    for _ in range(n):
        start = time.perf_counter()
        call()
        times.append((time.perf_counter() - start) * 1e3)
    times.sort()
    return {"name": name, "unit": "ms", "peer": times[len(times) // 2], "peer_name": peer, "n": n}


def labels(batch, people):
    i = np.arange(batch * people * 36)
    return ((i * 7919 % 3680) / 10).astype(np.float32).reshape(batch, people, 18, 2)


def encode(joints, size=368, stride=8, sigma=7.0, half=8.0):
    cells = size // stride
    c = ((np.arange(cells) + 0.5) * stride - 0.5).astype(np.float32)
    gx = np.exp(-((c - joints[..., 0, None]) ** 2) / (2 * sigma**2))
    gy = np.exp(-((c - joints[..., 1, None]) ** 2) / (2 * sigma**2))
    parts = (gy[..., :, None] * gx[..., None, :]).max(1)
    pcm = np.concatenate((parts, 1 - parts.max(1, keepdims=True)), 1)
    ends = np.array(LIMBS)
    a, b = joints[:, :, ends[:, 0]], joints[:, :, ends[:, 1]]
    along = b - a
    length = np.sqrt((along**2).sum(-1))
    unit = along / np.maximum(length, 1e-3)[..., None]
    dx, dy = c - a[..., 0, None], c - a[..., 1, None]
    ux, uy = unit[..., 0, None, None], unit[..., 1, None, None]
    forward = dx[..., None, :] * ux + dy[..., :, None] * uy
    sideways = dx[..., None, :] * uy - dy[..., :, None] * ux
    on = (forward >= 0) & (forward <= length[..., None, None]) & (np.abs(sideways) <= half)
    count = np.maximum(on.sum(1), 1)
    paf = np.stack(((on * ux).sum(1) / count, (on * uy).sum(1) / count), 2)
    masks = np.ones_like(pcm), np.ones((len(joints), 2 * len(LIMBS), cells, cells), np.float32)
    return pcm, paf.reshape(masks[1].shape), *masks


def noise(shape):
    return ((np.arange(np.prod(shape)) * 7919 % 1000) / 833 - 0.2).astype(np.float32).reshape(shape)


def fuse(pcm, paf, pcm_mask, paf_mask, pcm_t, paf_t, floor=0.1):
    parts = np.maximum(pcm[:, :-1], np.clip(pcm_t[:, :-1], 0, 1))
    out = np.concatenate((parts, 1 - parts.max(1, keepdims=True)), 1)
    answered = pcm_t[:, :-1] >= floor
    answered = np.concatenate((answered, answered.any(1, keepdims=True)), 1)
    pair = (paf.shape[0], -1, 2, *paf.shape[2:])
    own, other = paf.reshape(pair), paf_t.reshape(pair)
    n_own, n_other = (np.sqrt((f**2).sum(2, keepdims=True)) for f in (own, other))
    field = np.where(n_own > n_other, own, other).reshape(paf.shape)
    field_mask = np.where(np.broadcast_to(n_other >= floor, own.shape).reshape(paf.shape), np.float32(1), paf_mask)
    return out, field, np.where(answered, np.float32(1), pcm_mask), field_mask


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
    joints = labels(16, 2)
    rows.append(row("targets: encode 16 pictures of 368x368, 2 people", "NumPy, vectorised", 10, lambda: encode(joints)))
    maps = encode(joints)
    teacher = noise(maps[0].shape), noise(maps[1].shape)
    rows.append(row("targets: fuse 16 pictures of 368x368", "NumPy, vectorised", 20, lambda: fuse(*maps, *teacher)))

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
