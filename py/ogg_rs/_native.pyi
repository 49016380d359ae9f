import os
from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Arima",
    "Arm",
    "Codec",
    "Estimator",
    "Mixture",
    "MotionModel",
    "Recording",
    "Regressor",
    "Robot",
    "Scene",
    "Tracker",
    "Worker",
    "arima_errors",
    "auto_arima",
    "builtin_cards",
    "coco_sigmas",
    "controller_states",
    "crc16",
    "dbc_text",
    "decode",
    "encode_targets",
    "evaluate_keypoints",
    "fit_arima",
    "fit_mixture",
    "fuse_labels",
    "main",
    "published_limbs",
    "random_frame",
    "read_candump",
    "select_mixture",
    "skeleton_sources",
    "skeletons",
    "stop_causes",
    "worker_keypoints",
]

_Floats = NDArray[np.float64]
_Singles = NDArray[np.float32]
_Bytes = NDArray[np.uint8]
_Times = NDArray[np.uint64]

def main(arguments: list[str]) -> int: ...

@final
class Mixture:
    def __new__(cls, kind: str, weights: list[float], means: _Floats, covariances: _Floats) -> Mixture: ...
    @property
    def kind(self) -> str: ...
    @property
    def weights(self) -> _Floats: ...
    @property
    def means(self) -> _Floats: ...
    @property
    def covariances(self) -> _Floats: ...
    def log_densities(self, x: _Floats) -> _Floats: ...
    def responsibilities(self, x: _Floats) -> _Floats: ...
    def labels(self, x: _Floats) -> NDArray[np.int64]: ...
    def labels_seconds(self, x: _Floats, repeats: int) -> float: ...
    def condition(self, dimensions: list[int], values: list[float]) -> Mixture: ...

_Report = tuple[_Floats, bool, tuple[_Floats, _Floats] | None]

def fit_mixture(
    x: _Floats,
    *,
    components: int,
    covariance: str,
    init: str,
    restarts: int,
    max_iterations: int,
    tolerance: float,
    ridge: float,
    seed: int,
    weights: _Floats | None = None,
    start: Mixture | None = None,
    fusion: tuple[_Floats, str] | None = None,
) -> tuple[Mixture, _Report]: ...
def select_mixture(
    x: _Floats,
    *,
    least: int,
    most: int,
    criterion: str,
    covariance: str,
    init: str,
    restarts: int,
    max_iterations: int,
    tolerance: float,
    ridge: float,
    seed: int,
    weights: _Floats | None = None,
) -> tuple[Mixture, _Floats, _Report]: ...
def arima_errors(x: _Floats, lengths: list[int], order: tuple[int, int, int]) -> _Floats: ...
@final
class Regressor:
    def __new__(cls, mixture: Mixture, inputs: list[int], outputs: list[int]) -> Regressor: ...
    def means(self, x: _Floats) -> _Floats: ...
    def means_and_covariances(self, x: _Floats) -> tuple[_Floats, _Floats]: ...
    def derivatives(self, x: _Floats) -> _Floats: ...

@final
class Arima:
    def __new__(cls, ar: list[float], difference: int, ma: list[float], mean: float, variance: float) -> Arima: ...
    def parts(self) -> tuple[list[float], int, list[float], float, float]: ...
    def log_likelihood(self, y: _Floats) -> float: ...
    def filter(self, y: _Floats) -> tuple[float, _Floats, _Floats]: ...
    def forecast(self, y: _Floats, steps: int) -> tuple[_Floats, _Floats]: ...

def fit_arima(y: _Floats, order: tuple[int, int, int], constant: bool) -> Arima: ...
def auto_arima(y: _Floats, max_p: int, max_d: int, max_q: int) -> tuple[tuple[int, int, int], bool]: ...
@final
class Robot:
    @staticmethod
    def from_urdf(path: str | os.PathLike[str], base: str | None = None, tip: str | None = None) -> Robot: ...
    @staticmethod
    def builtin() -> Robot: ...
    @property
    def name(self) -> str: ...
    @property
    def base(self) -> str: ...
    @property
    def tip(self) -> str: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def position_limits(self) -> _Floats: ...
    def fk(self, q: _Floats) -> _Floats: ...
    def jacobian(self, q: _Floats) -> _Floats: ...
    def ik(self, targets: _Floats, seeds: _Floats) -> tuple[_Floats, NDArray[np.bool_], _Floats, _Floats]: ...
    def mass_matrix(self, q: _Floats) -> _Floats: ...
    def inverse_dynamics(self, q: _Floats, qd: _Floats, qdd: _Floats, gravity_m_s2: list[float]) -> _Floats: ...

@final
class Tracker:
    def __new__(
        cls,
        limits: _Floats,
        step_s: float,
        start: list[float],
        bandwidth_rad_s: float,
        coast_s: float,
        fade_s: float,
    ) -> Tracker: ...
    def offer(self, position: list[float], velocity: list[float]) -> None: ...
    def stop(self) -> None: ...
    @property
    def is_at_rest(self) -> bool: ...
    def command(self) -> _Floats: ...
    def step(self) -> _Floats: ...
    def track(self, positions: _Floats, velocities: _Floats) -> _Floats: ...

@final
class MotionModel:
    def __new__(cls, text: str) -> MotionModel: ...
    @staticmethod
    def teach(
        demonstrations: Sequence[tuple[_Floats, _Floats]],
        *,
        element_s: float,
        components: int,
        restarts: int,
        blend_s: float,
        seed: int,
        rate_hz: float,
        longest_gap_s: float,
        smoothing_s: float,
        shortest_period_s: float,
    ) -> tuple[MotionModel, dict[str, float]]: ...
    @staticmethod
    def load(path: str | os.PathLike[str]) -> MotionModel: ...
    def save(self, path: str | os.PathLike[str]) -> None: ...
    def to_json(self) -> str: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def is_cyclic(self) -> bool: ...
    @property
    def elements(self) -> int: ...
    @property
    def demonstrations(self) -> int: ...
    def at(self, times_s: _Floats) -> tuple[_Floats, _Floats, _Floats]: ...

_Limbs = Sequence[tuple[int, int, int, int]]
_Maps = tuple[_Singles, _Singles, _Singles, _Singles]

def skeletons() -> list[tuple[str, list[str], list[int], list[tuple[int, int]]]]: ...
def skeleton_sources(to: str, from_: str, /) -> list[tuple[int, int] | None]: ...
def published_limbs() -> list[tuple[int, int, int, int]]: ...
def builtin_cards() -> list[str]: ...
def coco_sigmas() -> list[float]: ...
def encode_targets(
    joints_px: _Singles,
    states: _Bytes,
    boxes_px: _Singles,
    *,
    skeleton: str,
    limbs: _Limbs,
    width: int,
    height: int,
    stride: int,
    sigma_px: float,
    half_width_px: float,
) -> _Maps: ...
def fuse_labels(
    pcm: _Singles,
    paf: _Singles,
    pcm_mask: _Singles,
    paf_mask: _Singles,
    teacher_pcm: _Singles,
    teacher_paf: _Singles,
    floor: float,
) -> _Maps: ...
def decode(
    pcm: _Singles,
    paf: _Singles,
    *,
    skeleton: str,
    limbs: _Limbs,
    stride: int,
    peak_threshold: float,
    paf_threshold: float,
    min_score: float,
) -> tuple[_Singles, _Singles]: ...
def evaluate_keypoints(
    gt_images: list[int],
    gt_keypoints: _Floats,
    gt_boxes: _Floats,
    gt_crowd: list[bool],
    dt_images: list[int],
    dt_keypoints: _Floats,
    dt_scores: list[float],
    *,
    sigmas: list[float],
    keypoints: list[int] | None,
    visibility: int | None,
    max_detections: int,
) -> list[float | None]: ...
@final
class Estimator:
    def __new__(
        cls,
        card: str,
        *,
        weights_dirs: list[str],
        library: str | None,
        site_packages: list[str],
        provider: str,
        fallback: str | None,
        threads: int | None,
    ) -> Estimator: ...
    @property
    def name(self) -> str: ...
    @property
    def skeleton(self) -> str: ...
    @property
    def runtime(self) -> str: ...
    def estimate(self, image: _Bytes) -> tuple[_Singles, _Singles]: ...
    def reset(self) -> None: ...

_Frame = tuple[_Bytes, _Floats, _Floats, _Bytes, _Floats]

@final
class Arm:
    def __new__(
        cls,
        urdf: str | None,
        *,
        start: list[float] | None,
        gravity_m_s2: list[float],
        servo_hz: float,
        damping_ratio: float,
        gravity_compensation: float,
        substep_s: float,
    ) -> Arm: ...
    @property
    def joint_names(self) -> list[str]: ...
    def measured(self) -> tuple[_Floats, _Floats]: ...
    def run(self, positions: _Floats, velocities: _Floats, dt_s: float, brake: bool) -> tuple[_Floats, _Floats]: ...
    def gravity_load(self, q: list[float]) -> _Floats: ...

@final
class Worker:
    def __new__(
        cls, seed: int, action: str, repetitions: int, period_s: float, variation: float, amplitude: float
    ) -> Worker: ...
    def poses(self, times_s: _Floats) -> tuple[_Floats, list[str], _Floats]: ...

@final
class Scene:
    def __new__(cls, worker: Worker, width: int, height: int) -> Scene: ...
    def render(self, t_s: float) -> _Frame: ...

def worker_keypoints() -> list[str]: ...
def random_frame(seed: int, width: int, height: int) -> _Frame: ...

_Wire = tuple[int, bytes]

@final
class Codec:
    def __new__(cls, robot: int) -> Codec: ...
    def set(self, counter: int, pair: int, angles_rad: list[float]) -> _Wire: ...
    def feedback(self, counter: int, pair: int, angles_rad: list[float]) -> _Wire: ...
    def commit(
        self,
        counter: int,
        position: bool,
        enable: bool,
        quick_stop: bool,
        reset: bool,
        test: bool,
        speed_scale: float,
        horizon_s: float,
        host_time: int,
    ) -> _Wire: ...
    def status(
        self,
        counter: int,
        state: str,
        powered: bool,
        at_rest: bool,
        limiting: bool,
        set_dropped: bool,
        cause_code: int,
        echo: int,
        echo_age_s: float,
        tracking_error_rad: float,
    ) -> _Wire: ...
    def stop(self, counter: int, to_controller: bool, inverted: bool, cause_code: int, joint: int) -> _Wire: ...
    def config(self, counter: int, reply: bool, key: int, value: int) -> _Wire: ...
    def heartbeat(self, node_state: int) -> _Wire: ...
    def decode(self, id: int, data: list[int]) -> tuple[str, int, list[tuple[str, float]]] | None: ...

def dbc_text() -> str: ...
def crc16(data_id: int, data: list[int]) -> int: ...
def stop_causes() -> list[tuple[int, str]]: ...
def controller_states() -> list[str]: ...
def read_candump(text: str) -> tuple[_Floats, list[str], NDArray[np.uint16], _Bytes, _Bytes]: ...
@final
class Recording:
    def __new__(cls, path: str) -> Recording: ...
    @property
    def facts(self) -> dict[str, str]: ...
    @property
    def topics(self) -> list[tuple[str, str, str, int]]: ...
    @property
    def attachments(self) -> dict[str, bytes]: ...
    @property
    def cut(self) -> str | None: ...
    @property
    def time_range_ns(self) -> tuple[int, int] | None: ...
    def joint_table(self, stream: str) -> tuple[_Times, list[str], dict[str, _Floats]]: ...
    def keypoint_table(self) -> tuple[_Times, list[str], _Floats, _Bytes]: ...
    def metrics(self) -> tuple[_Times, list[str], _Floats, list[str]]: ...
    def log(self) -> tuple[_Times, bytes, list[str], list[str]]: ...
    def transforms(self) -> tuple[_Times, list[str], list[str], _Floats]: ...
    def pictures(self, topic: str) -> tuple[_Times, list[bytes]]: ...
