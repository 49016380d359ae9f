"""The posed body: shape, pose and regions of the surface.

Axes of the body: x to its left, y to its back, z up, metres. Every bone's rotation is given in these axes, relative to its
parent, so the rotation of a bone in space is the product of the rotations from the root to it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ..puppets import _elbow as bend_elbow
from ..skeleton import COCO17

TEXELS = 256
"""Side of the square texture of body and clothes."""

SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
_J = {name: i for i, name in enumerate(COCO17)}


class Region(IntEnum):
    """Parts of the surface that are coloured and thickened alike."""

    SKIN = 0
    TORSO = 1
    UPPER_SLEEVE = 2
    LOWER_SLEEVE = 3
    LEGS = 4
    HAIR = 5
    FEET = 6
    EYES = 7


_REGION_OF_BONE = (
    (("spine", "clavicle", "shoulder", "pelvis", "root"), Region.TORSO),
    (("upperarm",), Region.UPPER_SLEEVE),
    (("lowerarm",), Region.LOWER_SLEEVE),
    (("upperleg", "lowerleg"), Region.LEGS),
    (("foot", "toe"), Region.FEET),
    (("eye",), Region.EYES),
)


def rotation(axis: NDArray[np.float64] | tuple[float, float, float], angle_rad: float) -> NDArray[np.float64]:
    """Rotation matrix about `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis, float) / max(float(np.linalg.norm(axis)), 1e-12)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle_rad) * k + (1 - np.cos(angle_rad)) * (k @ k)


def turned(x_deg: float = 0.0, y_deg: float = 0.0, z_deg: float = 0.0) -> NDArray[np.float64]:
    """Turns about x, then y, then z of the fixed axes."""
    rx, ry, rz = (rotation(axis, np.radians(d)) for axis, d in zip(np.eye(3), (x_deg, y_deg, z_deg), strict=True))
    return rz @ ry @ rx


def between(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest rotation that turns direction `a` into direction `b`."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-9:
        return np.eye(3) if a @ b > 0 else rotation(np.cross(a, [1.0, 0.3, 0.2]), np.pi)
    return rotation(axis, float(np.arctan2(np.linalg.norm(axis), a @ b)))


@dataclass
class Posed:
    """A body in a pose: vertices, COCO joints `(17, 3)`, the height of its table and where its hands work."""

    vertices: NDArray[np.float64]
    joints: NDArray[np.float64]
    seated: bool
    table_z: float
    work: NDArray[np.float64]


class Body:
    """The parametric body with its texture layout. Loading takes a while the first time: the package compiles its data."""

    def __init__(self) -> None:
        import anny
        import torch
        from anny.keypoints import KeypointsRegressor

        self._torch = torch
        self._model = anny.Anny().to(dtype=torch.float32)
        self._joints = KeypointsRegressor.coco(self._model)
        self._bones = {name: i for i, name in enumerate(self._model.bone_labels)}
        triangles = self._model.get_triangular_faces() if callable(getattr(self._model, "get_triangular_faces", None)) else None
        self.faces = np.asarray(self._model.faces if triangles is None else triangles)
        texture_faces = np.asarray(self._model.face_texture_coordinate_indices)
        coordinates = np.asarray(self._model.texture_coordinates, np.float32)
        corners = np.stack([self.faces.ravel(), texture_faces.ravel()], 1)
        pairs, inverse = np.unique(corners, axis=0, return_inverse=True)
        self.split_vertices, self.split_uv = pairs[:, 0], coordinates[pairs[:, 1]]
        self.split_faces = inverse.reshape(-1, 3)
        self.regions = self._regions()
        self.region_map = self._paint_regions(texture_faces, coordinates)

    def _regions(self) -> NDArray[np.int64]:
        bones, weights = np.asarray(self._model.vertex_bone_indices), np.asarray(self._model.vertex_bone_weights)
        owner = np.array(self._model.bone_labels)[bones[np.arange(len(bones)), weights.argmax(1)]]
        regions = np.full(len(owner), int(Region.SKIN))
        for prefixes, region in _REGION_OF_BONE:
            regions[[name.startswith(prefixes) for name in owner]] = region
        head = np.array([name.startswith(("head", "neck03")) for name in owner])
        rest = np.asarray(self._model.template_vertices)
        below = rest[head, 2].max() - rest[:, 2]
        front, back = rest[head, 1].min(), rest[head, 1].max()
        depth = (rest[:, 1] - front) / (back - front)
        scalp = ((below < 0.05) & (depth > 0.2)) | ((below < 0.1) & (depth > 0.5)) | ((below < 0.17) & (depth > 0.62))
        regions[head & scalp & (regions != Region.EYES)] = Region.HAIR
        return regions

    def _paint_regions(self, texture_faces: NDArray, coordinates: NDArray) -> NDArray[np.uint8]:
        picture = Image.new("L", (TEXELS, TEXELS))
        draw = ImageDraw.Draw(picture)
        for face, corners in zip(self.faces, texture_faces, strict=True):
            uv = coordinates[corners] * TEXELS
            region = int(np.bincount(self.regions[face]).argmax())
            draw.polygon([(float(u), float(TEXELS - v)) for u, v in uv], fill=region, outline=region)
        return np.asarray(picture)

    def _forward(self, pose: NDArray[np.float64], shape: dict[str, float]) -> tuple[NDArray, NDArray]:
        torch = self._torch
        with torch.no_grad():
            answer = self._model(pose_parameters=torch.tensor(pose, dtype=torch.float32)[None], phenotype_kwargs=shape)
            joints = self._joints(answer)[0].numpy()[:17]
        return answer["vertices"][0].numpy().astype(np.float64), joints.astype(np.float64)

    def sample(self, rng: np.random.Generator, *, worker: bool) -> Posed:
        """A random body: a `worker` at a table with the hands at the work, or anybody in any upright pose."""
        u = rng.uniform
        shape = {
            "gender": u(0, 1), "age": u(0.55, 0.95), "muscle": u(0.2, 0.8), "weight": u(0.2, 0.9), "height": u(0.25, 0.8),
            "proportions": u(0.3, 0.9),
        }  # fmt: skip
        pose = np.tile(np.eye(4), (len(self._bones), 1, 1))
        _, rest = self._forward(pose, shape)

        def turn(bone: str, matrix: NDArray[np.float64]) -> None:
            pose[self._bones[bone], :3, :3] = matrix

        for side, sign in (("L", 1), ("R", -1)):
            if worker:
                turn(f"upperleg01.{side}", turned(-u(72, 96), 0, sign * u(0, 14)))
                turn(f"lowerleg01.{side}", turned(u(65, 100)))
            else:
                turn(f"upperleg01.{side}", turned(-u(-20, 35) if rng.random() < 0.8 else -u(30, 100), sign * u(-12, 2), 0))
                turn(f"lowerleg01.{side}", turned(u(0, 30) if rng.random() < 0.7 else u(0, 90)))
        lean = u(0, 30) if worker else (u(-8, 18) if rng.random() < 0.75 else u(0, 70))
        bend = turned(lean / 5, u(-9, 9) / 5, u(-18, 18) / 5)
        trunk = np.eye(3)
        for bone in SPINE:
            turn(bone, bend)
            trunk = trunk @ bend
        nod = u(0, 18) if worker else u(-8, 14)
        for bone in ("neck01", "neck02", "head"):
            turn(bone, turned(nod * u(0.5, 1.2), u(-5, 5), u(-14, 14)))

        _, joints = self._forward(pose, shape)
        table = joints[[11, 12], 2].mean() + u(0.12, 0.28)
        work = np.array([u(-0.14, 0.14), joints[[5, 6], 1].mean() - u(0.26, 0.48), table])
        for side, sign, name in (("L", 1, "left"), ("R", -1, "right")):
            s, e, w = (_J[f"{name}_{part}"] for part in ("shoulder", "elbow", "wrist"))
            upper, fore = rest[e] - rest[s], rest[w] - rest[e]
            target = self._hand_target(rng, joints[s], work, sign, worker=worker)
            pole = np.array([sign * u(0.1, 1.0), u(-0.1, 0.8), -u(0.1, 1.0)])
            elbow, wrist = bend_elbow(
                joints[s], target, float(np.linalg.norm(upper)), float(np.linalg.norm(fore)), pole
            )
            upper_turn = between(upper, trunk.T @ (elbow - joints[s]))
            turn(f"upperarm01.{side}", upper_turn)
            turn(f"lowerarm01.{side}", between(fore, upper_turn.T @ trunk.T @ (wrist - elbow)))
            turn(f"lowerarm02.{side}", rotation(fore, np.radians(u(-50, 50))))
            turn(f"wrist.{side}", turned(*u(-25, 25, 3)))
            curl = u(0, 40)
            for finger in range(2, 6):
                for joint in range(1, 4):
                    turn(f"finger{finger}-{joint}.{side}", turned(0, sign * curl * u(0.4, 1.2), 0))
        vertices, joints = self._forward(pose, shape)
        return Posed(vertices, joints, worker, float(table), work)

    @staticmethod
    def _hand_target(
        rng: np.random.Generator, shoulder: NDArray, work: NDArray, sign: int, *, worker: bool
    ) -> NDArray[np.float64]:
        u, kind = rng.uniform, rng.random()
        if worker and kind < 0.72:
            return work + (sign * u(-0.02, 0.28), u(-0.14, 0.12), u(0.02, 0.1))
        if kind < 0.8:
            if not worker and rng.random() < 0.35:
                return shoulder + (sign * u(-0.02, 0.25), u(-0.2, 0.12), -u(0.42, 0.62))
            reach = rng.normal(size=3) * (1.0, 0.8, 1.2)
            reach[1] = -abs(reach[1]) if rng.random() < 0.85 else reach[1]
            reach[0] = sign * abs(reach[0]) if rng.random() < 0.7 else reach[0]
            return shoulder + reach / np.linalg.norm(reach) * u(0.22, 0.6)
        if kind < 0.9:
            return shoulder + (sign * u(-0.1, 0.45), -u(0.0, 0.3), u(0.05, 0.5))
        return shoulder + (sign * u(0.0, 0.25), -u(0, 0.2), -u(0.4, 0.6))


@functools.cache
def body() -> Body:
    """The one body of this process."""
    return Body()
