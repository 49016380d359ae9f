"""One picture: people, furniture, fabric, camera and light, and what each joint is covered by."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..skeleton import COCO17
from . import look
from .body import Posed, Region, body, turned

NEAR_M, FAR_M = 0.05, 20.0
_INSIDE_M = {"shoulder": 0.11, "elbow": 0.075, "wrist": 0.06, "hip": 0.17, "knee": 0.1, "ankle": 0.08}
"""How far below the surface the joint's centre may lie: nearer surface than that before it covers it."""
_J = {name: i for i, name in enumerate(COCO17)}
INSIDE_M = np.array([_INSIDE_M.get(name.split("_")[-1], 0.08) for name in COCO17])


@dataclass(frozen=True)
class Person:
    """COCO joints `(17, 2)` in continuous pixels and `(17, 3)` in metres before the camera (x right, y down, z forward)."""

    joints_px: NDArray[np.float64]
    joints_m: NDArray[np.float64]
    visible: NDArray[np.bool_]
    under_fabric: NDArray[np.bool_]


@dataclass(frozen=True)
class Shot:
    """A picture and its people."""

    image: Image.Image
    people: list[Person]


def load_renderer() -> object:
    """The module `pyrender` on EGL, or an `ImportError` that says what to install."""
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    os.environ.setdefault("LP_NUM_THREADS", "1")
    if not hasattr(np, "infty"):
        np.infty = np.inf  # pyrender 0.1.45 uses the name that NumPy 2 dropped
    try:
        import anny  # noqa: F401
        import pyrender
    except ImportError as error:
        raise ImportError(
            f"{error}: the people need `pip install anny==0.6.2 pyrender==0.1.45 torch` and the system libraries of EGL "
            "(Debian: apt install libegl1 libgl1-mesa-dri)"
        ) from error
    return pyrender


def upward_faces(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
    """Two triangles for each cell of a grid `x, y (rows, columns)`, all turned so that their fronts look up, whichever way it runs."""
    rows, columns = x.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    down = (x[1, 0] - x[0, 0]) * (y[0, 1] - y[0, 0]) - (y[1, 0] - y[0, 0]) * (x[0, 1] - x[0, 0]) < 0
    return faces[:, ::-1] if down else faces


class Studio:
    """Renders shots of one size."""

    def __init__(
        self, size: tuple[int, int], backgrounds: look.Backgrounds, *, second: float, sewing: bool = False
    ) -> None:
        self._gl = load_renderer()
        import trimesh

        self._trimesh = trimesh
        self.size, self.backgrounds, self.second, self.sewing = size, backgrounds, second, sewing
        self._renderer = self._gl.OffscreenRenderer(*size)

    def shot(self, rng: np.random.Generator) -> Shot:
        """The next picture of this generator."""
        gl, figure = self._gl, body()
        worker = bool(rng.random() < 0.6) or self.sewing
        posed = [figure.sample(rng, worker=worker)]
        if rng.random() < self.second:
            posed.append(self._beside(rng, posed[0], figure.sample(rng, worker=rng.random() < 0.4)))
        scene = gl.Scene(bg_color=[0, 0, 0, 0], ambient_light=np.full(3, rng.uniform(0.15, 0.6)))
        for person in posed:
            scene.add(gl.Mesh([self._dressed(rng, person)]))
        cloth = None
        if worker and (rng.random() < 0.92 or self.sewing):
            cloth = self._bench(rng, scene, posed[0])
        for _ in range(int(rng.integers(0, 4))):
            at = posed[0].joints[[5, 6]].mean(0) + (rng.uniform(-1.4, 1.4), rng.uniform(0.15, 1.8), rng.uniform(-1.2, 0.5))
            self._box(rng, scene, rng.uniform(0.05, 0.7, 3), at, rng.uniform(0, 90))
        camera = self._camera(rng, scene, posed[0], worker=worker)
        self._light(rng, scene, camera.pose)
        colour, depth = self._renderer.render(scene, flags=gl.RenderFlags.RGBA)
        cloth_depth = self._alone(cloth, camera) if cloth is not None else None
        image = look.photographed(rng, colour, self.backgrounds.crop(rng, self.size))
        return Shot(image, [self._label(person, camera, depth, cloth_depth) for person in posed])

    @staticmethod
    def _beside(rng: np.random.Generator, first: Posed, second: Posed) -> Posed:
        """The second person moved next to or behind the first, turned about the vertical."""
        turn = turned(0, 0, rng.uniform(-70, 70) + (180 if rng.random() < 0.2 else 0))
        to = first.joints[[11, 12]].mean(0) + (rng.choice([-1, 1]) * rng.uniform(0.45, 0.95), rng.uniform(-0.1, 0.9), 0)
        middle = second.joints[[11, 12]].mean(0)
        to[2] = first.joints[:, 2].min() + middle[2] - second.joints[:, 2].min()

        def move(points: NDArray[np.float64]) -> NDArray[np.float64]:
            return (points - middle) @ turn.T + to

        return Posed(move(second.vertices), move(second.joints), second.seated, second.table_z, second.work)

    def _material(self, texture: Image.Image, roughness: float) -> object:
        return self._gl.MetallicRoughnessMaterial(
            baseColorTexture=self._gl.Texture(source=texture, source_channels="RGB"),
            metallicFactor=0.0, roughnessFactor=roughness, doubleSided=True,
        )  # fmt: skip

    def _dressed(self, rng: np.random.Generator, person: Posed) -> object:
        """The body thickened where clothes and hair are, with a fresh outfit."""
        figure = body()
        texture, clothed = look.outfit(rng, figure.region_map, self.backgrounds)
        normals = np.asarray(self._trimesh.Trimesh(person.vertices, figure.faces, process=False).vertex_normals)
        wave = np.sin(person.vertices * rng.uniform(8, 45, 3) + rng.uniform(0, 6, 3)).prod(1)
        thick = np.where(np.isin(figure.regions, list(clothed)), rng.uniform(0.003, 0.024) * (1 + 0.7 * wave), 0.0)
        hair = figure.regions == Region.HAIR
        thick[hair] = rng.uniform(0.004, 0.03) * (1 + 0.3 * wave[hair])
        surface = person.vertices + normals * np.maximum(thick, 0)[:, None]
        shaded = np.asarray(self._trimesh.Trimesh(surface, figure.faces, process=False).vertex_normals)
        return self._gl.Primitive(
            positions=surface[figure.split_vertices].astype(np.float32),
            normals=shaded[figure.split_vertices].astype(np.float32),
            texcoord_0=figure.split_uv, indices=figure.split_faces.astype(np.uint32),
            material=self._material(texture, rng.uniform(0.55, 1.0)),
        )  # fmt: skip

    def _box(
        self, rng: np.random.Generator, scene: object, extents: NDArray | tuple, at: NDArray | tuple, yaw_deg: float,
        colour: NDArray | None = None,
    ) -> None:  # fmt: skip
        mesh = self._trimesh.creation.box(np.asarray(extents, float))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turned(0, 0, yaw_deg), at
        mesh.apply_transform(pose)
        tint = self._paint(rng) if colour is None else colour
        material = self._gl.MetallicRoughnessMaterial(
            baseColorFactor=tint, metallicFactor=rng.uniform(0, 0.4), roughnessFactor=rng.uniform(0.3, 1)
        )
        scene.add(self._gl.Mesh.from_trimesh(mesh, smooth=False, material=material))

    @staticmethod
    def _paint(rng: np.random.Generator) -> NDArray[np.float64]:
        grey = rng.normal(rng.choice([0.15, 0.5, 0.85]), 0.1)
        return np.append(np.clip(grey * rng.uniform(0.75, 1.2, 3), 0, 1), 1.0)

    def _sheet(self, x: NDArray, y: NDArray, z: NDArray, texture: look.Pixels) -> object:
        """A surface over a grid, as a mesh with texture."""
        rows, columns = x.shape
        points = np.stack((x, y, z), -1).reshape(-1, 3)
        faces = upward_faces(x, y)
        uv = np.stack(np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows)), -1).reshape(-1, 2)
        normals = np.asarray(self._trimesh.Trimesh(points, faces, process=False).vertex_normals, np.float32)
        picture = Image.fromarray(np.clip(texture, 0, 255).astype(np.uint8))
        primitive = self._gl.Primitive(
            positions=points.astype(np.float32), normals=normals, texcoord_0=uv.astype(np.float32),
            indices=faces.astype(np.uint32), material=self._material(picture, 0.95),
        )  # fmt: skip
        return self._gl.Mesh([primitive])

    def _bench(self, rng: np.random.Generator, scene: object, person: Posed) -> object | None:
        """Table, chair, machine and fabric; returns the fabric's mesh."""
        u, top, work = rng.uniform, person.table_z, person.work
        edge, deep, wide, at = person.joints[[11, 12], 1].mean() - u(0.2, 0.32), u(0.5, 0.9), u(0.9, 1.7), u(-0.2, 0.2)
        x, y = np.meshgrid(np.linspace(at - wide / 2, at + wide / 2, 2), np.linspace(edge, edge - deep, 2))
        scene.add(self._sheet(x, y, np.full_like(x, top), look.fabric(rng, self.backgrounds, 128)))
        self._box(rng, scene, (wide, deep, 0.04), (at, edge - deep / 2, top - 0.025), 0)
        if rng.random() < 0.75:
            self._machine(rng, scene, work, top)
        if rng.random() < 0.5:
            hips = person.joints[[11, 12]].mean(0)
            self._box(rng, scene, (u(0.4, 0.6), 0.06, 0.6), hips + (0, 0.22, 0.3), 0)
        if rng.random() < 0.22 and not self.sewing:
            return None
        cloth = self._cloth(rng, person, top, work)
        scene.add(cloth)
        return cloth

    def _machine(self, rng: np.random.Generator, scene: object, work: NDArray, top: float) -> None:
        """A sewing machine of six blocks: bed, column, arm, head, needle bar, wheel."""
        u = rng.uniform
        colour, x, y, yaw = self._paint(rng), work[0] + u(-0.08, 0.2), work[1] - u(0.02, 0.16), u(-12, 12)
        high, side = u(0.22, 0.32), rng.choice([-1, 1])
        for extents, along, z in (
            ((0.42, 0.17, 0.05), 0.12, 0.025), ((0.1, 0.14, high), 0.28, high / 2), ((0.4, 0.11, 0.09), 0.12, high),
            ((0.08, 0.1, 0.14), -0.05, high - 0.06), ((0.012, 0.012, 0.12), -0.05, high - 0.19), ((0.03, 0.1, 0.1), 0.35, high),
        ):  # fmt: skip
            self._box(rng, scene, extents, (x + side * along, y, top + z), yaw, colour)

    def _cloth(self, rng: np.random.Generator, person: Posed, top: float, work: NDArray) -> object:
        """A piece of fabric on the table; more often than not it lies over the hands."""
        u, n = rng.uniform, 64
        wide, deep = u(0.3, 0.8), u(0.25, 0.6)
        cx, cy = work[0] + u(-0.18, 0.18), work[1] + u(-0.15, 0.12)
        x, y = np.meshgrid(np.linspace(cx - wide / 2, cx + wide / 2, n), np.linspace(cy - deep / 2, cy + deep / 2, n))
        z = np.full((n, n), top + 0.006, np.float32)
        if rng.random() < 0.65 or self.sewing:
            over = person.vertices - (cx - wide / 2, cy - deep / 2, 0)
            near = (over[:, :2] > 0).all(1) & (over[:, 0] < wide) & (over[:, 1] < deep) & (np.abs(over[:, 2] - top - 0.07) < 0.1)
            column, row = (np.rint(over[near, k] / span * (n - 1)).astype(int) for k, span in ((0, wide), (1, deep)))
            np.maximum.at(z, (row, column), over[near, 2].astype(np.float32) + 0.012)
            # Fabric spans between what it lies on: the highest of its neighbourhood, then smooth.
            spread = z
            for shift in (1, 2):
                for axis in (0, 1):
                    spread = np.maximum(spread, np.maximum(np.roll(spread, shift, axis), np.roll(spread, -shift, axis)))
            for _ in range(4):
                for axis in (0, 1):
                    spread = (2 * spread + np.roll(spread, 1, axis) + np.roll(spread, -1, axis)) / 4
            z = np.maximum(spread, top + 0.006)
        folds = look.smooth_noise(rng, (n, n), int(rng.integers(5, 16)))[..., 0]
        return self._sheet(x, y, z + np.maximum(folds, 0) * u(0.002, 0.015), look.fabric(rng, self.backgrounds, 192))

    def _camera(self, rng: np.random.Generator, scene: object, person: Posed, *, worker: bool) -> _Camera:
        """Looks at the arms of the person from most sides, mostly from the front and from above."""
        arms = person.joints[[5, 6, 7, 8, 9, 10]]
        target = arms.mean(0) + rng.normal(0, 0.07, 3)
        azimuth = np.radians(np.clip(rng.normal(0, 55), -150, 150) if worker else rng.normal(0, 80))
        elevation = np.radians(np.clip(rng.normal(25, 22), -10, 85) if worker else np.clip(rng.normal(8, 15), -20, 60))
        field = np.radians(rng.uniform(25, 62))
        spread = 2 * float(np.linalg.norm(arms - arms.mean(0), axis=1).max())
        extent = max(spread * rng.uniform(1.0, 1.5), rng.uniform(0.7, 1.5)) * (1.0 if rng.random() < 0.75 else rng.uniform(1.0, 1.8))
        wanted = extent / 2 / np.tan(field / 2)
        distance = max(wanted, 0.85)
        back = np.array([np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
        eye = target + back * distance
        across = np.cross(-back, (0.0, 0.0, 1.0) if abs(back[2]) < 0.97 else (0.0, -1.0, 0.0))
        across /= np.linalg.norm(across)
        up = np.cross(across, -back)
        roll = np.radians(rng.normal(0, 7))
        across, up = np.cos(roll) * across + np.sin(roll) * up, np.cos(roll) * up - np.sin(roll) * across
        focal = min(self.size) / 2 / np.tan(field / 2) * distance / wanted
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.stack((across, up, back), 1), eye
        camera = _Camera(pose, float(focal), (self.size[0] / 2, self.size[1] / 2))
        scene.add(camera.node(self._gl), pose=pose)
        return camera

    def _light(self, rng: np.random.Generator, scene: object, camera: NDArray[np.float64]) -> None:
        for _ in range(int(rng.integers(1, 4))):
            towards = rng.normal(size=3)
            towards[2] = abs(towards[2]) + 0.3
            towards += camera[:3, 2] * rng.uniform(0, 1.5)
            z = towards / np.linalg.norm(towards)
            x = np.cross((0.0, 0.0, 1.0), z)
            x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-3 else np.array([1.0, 0, 0])
            pose = np.eye(4)
            pose[:3, :3] = np.stack((x, np.cross(z, x), z), 1)
            colour = np.clip(rng.normal(1, 0.08, 3), 0.6, 1.3)
            scene.add(self._gl.DirectionalLight(color=colour, intensity=rng.uniform(0.8, 3.2)), pose=pose)

    def _alone(self, mesh: object, camera: _Camera) -> NDArray[np.float32]:
        """Depth of one mesh without the rest, seen from both of its sides."""
        scene = self._gl.Scene()
        scene.add(mesh)
        scene.add(camera.node(self._gl), pose=camera.pose)
        flags = self._gl.RenderFlags.DEPTH_ONLY | self._gl.RenderFlags.SKIP_CULL_FACES
        return self._renderer.render(scene, flags=flags)

    def _label(
        self, person: Posed, camera: _Camera, depth: NDArray[np.float32], cloth: NDArray[np.float32] | None
    ) -> Person:
        pixels, local = camera.project(person.joints)
        column, row = (np.floor(pixels[:, k]).astype(int) for k in (0, 1))
        inside = (column >= 0) & (column < self.size[0]) & (row >= 0) & (row < self.size[1]) & (local[:, 2] > NEAR_M)
        column, row = np.where(inside, column, 0), np.where(inside, row, 0)

        def covers(map_m: NDArray[np.float32], margin: NDArray[np.float64] | float) -> NDArray[np.bool_]:
            there = map_m[row, column]
            return (there > 0) & (there < local[:, 2] - margin)

        under = covers(cloth, 0.0) & inside if cloth is not None else np.zeros(len(inside), bool)
        return Person(pixels, local, inside & ~covers(depth, INSIDE_M) & ~under, under)


@dataclass(frozen=True)
class _Camera:
    """A pinhole; `pose` from its axes (x right, y up, z back) to the room's."""

    pose: NDArray[np.float64]
    focal_px: float
    centre_px: tuple[float, float]

    def node(self, gl: object) -> object:
        return gl.IntrinsicsCamera(self.focal_px, self.focal_px, *self.centre_px, znear=NEAR_M, zfar=FAR_M)

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Continuous pixels, and metres with x right, y down, z forward."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3] * (1, -1, -1)
        depth = np.maximum(local[:, 2:], 1e-3)
        return self.focal_px * local[:, :2] / depth + self.centre_px, local
