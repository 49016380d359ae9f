"""Compares forward kinematics, Jacobian, its rate, mass matrix and inverse dynamics with Pinocchio.

    python crates/kin/benches/pinocchio_check.py [--states 100000] [--fixture]

Needs `pin` and `example-robot-data` (benches/peers-requirements.txt); builds and runs the example
`pinocchio_exchange`. Prints the largest differences per robot and ends with 1 if any exceeds 1e-10 (relative to the larger
of 1 and the largest entry of the quantity in that state). `--fixture` writes tests/fixtures/pinocchio.json instead: a few
states of the project's own descriptions, so that the crate's tests have Pinocchio's word without Pinocchio.
"""

import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
TOLERANCE = 1e-10
GRAVITY = 9.81
# Robot description in example-robot-data, and the link that is its tip.
ROBOTS = [
    ("ur_description/urdf/ur3_robot.urdf", "tool0"),
    ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    ("xarm_description/urdf/xarm7.urdf", "link7"),
    ("panda_description/urdf/panda.urdf", "panda_hand"),
    ("z1_description/urdf/z1.urdf", "link06"),
    ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    ("so_arm_description/urdf/so100.urdf", None),
    ("so_arm_description/urdf/so101.urdf", None),
]


def robots_folder() -> pathlib.Path:
    for folder in map(pathlib.Path, sys.path):
        candidate = folder / "cmeel.prefix/share/example-robot-data/robots"
        if candidate.is_dir():
            return candidate
    sys.exit("example-robot-data is not installed")


def exchange() -> list[str]:
    if binary := os.environ.get("PINOCCHIO_EXCHANGE"):
        return [binary]
    command = ["cargo", "build", "--release", "--quiet", "-p", "kin", "--example", "pinocchio_exchange"]
    subprocess.run(command, cwd=ROOT, check=True)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return [str(target / "release/examples/pinocchio_exchange")]


def mimics(urdf: pathlib.Path) -> dict[str, tuple[str, float, float]]:
    found = {}
    for joint in ElementTree.parse(urdf).getroot().iter("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            numbers = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
            found[joint.get("name")] = (mimic.get("joint"), *numbers)
    return found


class Reference:
    """Pinocchio's answers in the joint order of `names`."""

    def __init__(self, urdf: pathlib.Path, names: list[str], tip: str | None):
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
        self.data = self.model.createData()
        tips = [frame.name for frame in self.model.frames if frame.type == pin.FrameType.BODY]
        self.tip = tip or tips[-1]
        self.frame = self.model.getFrameId(self.tip, pin.FrameType.BODY)
        followers = mimics(urdf)
        # Velocity of Pinocchio's joints from that of the independent ones, which holds for the mimic joints too.
        self.spread = np.zeros((self.model.nv, len(names)))
        self.shift = np.zeros(self.model.nv)
        for joint in range(1, self.model.njoints):
            name, row = self.model.names[joint], self.model.idx_vs[joint]
            master, factor, offset = followers.get(name, (name, 1.0, 0.0))
            self.spread[row, names.index(master)] = factor
            self.shift[row] = offset

    def limits(self, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = -np.pi * np.ones(len(names)), np.pi * np.ones(len(names))
        for joint in range(1, self.model.njoints):
            name = self.model.names[joint]
            if name in names and self.model.nqs[joint] == 1:
                at = self.model.idx_qs[joint]
                lower[names.index(name)] = max(-np.pi, self.model.lowerPositionLimit[at])
                upper[names.index(name)] = min(np.pi, self.model.upperPositionLimit[at])
        return lower, upper

    def configuration(self, q: np.ndarray) -> np.ndarray:
        values = self.spread @ q + self.shift
        full = np.zeros(self.model.nq)
        for joint in range(1, self.model.njoints):
            value, at = values[self.model.idx_vs[joint]], self.model.idx_qs[joint]
            if self.model.nqs[joint] == 2:
                full[at : at + 2] = np.cos(value), np.sin(value)
            else:
                full[at] = value
        return full

    def answer(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> dict[str, np.ndarray]:
        model, data, spread = self.model, self.data, self.spread
        full, v, a = self.configuration(q), spread @ qd, spread @ qdd
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobiansTimeVariation(model, data, full, v)
        pin.updateFramePlacements(model, data)
        pose = data.oMf[self.frame]
        jacobian = pin.getFrameJacobian(model, data, self.frame, axes) @ spread
        rate = pin.getFrameJacobianTimeVariation(model, data, self.frame, axes) @ spread
        mass = pin.crba(model, data, full)
        mass = np.triu(mass) + np.triu(mass, 1).T
        torque = pin.rnea(model, data, full, v, a)
        return {
            "pose": np.concatenate([pose.rotation.ravel(), pose.translation]),
            "jacobian": jacobian.ravel(),
            "rate": rate.ravel(),
            "mass": (spread.T @ mass @ spread).ravel(),
            "torque": spread.T @ torque,
        }


def states(reference: Reference, names: list[str], count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    lower, upper = reference.limits(names)
    q = random.uniform(lower, upper, (count, len(names)))
    return np.concatenate([q, random.uniform(-2, 2, q.shape), random.uniform(-5, 5, q.shape)], axis=1)


def names_of(program: list[str], urdf: pathlib.Path) -> list[str]:
    listed = subprocess.run([*program, "names", str(urdf)], capture_output=True, text=True, check=True)
    return listed.stdout.split("\n")[:-1]


def check(program: list[str], urdf: pathlib.Path, tip: str | None, count: int) -> dict[str, float]:
    names = names_of(program, urdf)
    reference = Reference(urdf, names, tip)
    dof = len(names)
    block = states(reference, names, count, seed=1)
    with tempfile.TemporaryDirectory() as folder:
        given, made = pathlib.Path(folder, "in"), pathlib.Path(folder, "out")
        block.astype("<f8").tofile(given)
        subprocess.run([*program, "run", str(urdf), reference.tip, str(given), str(made)], check=True)
        ours = np.memmap(made, dtype="<f8", mode="r").reshape(count, -1)
        sizes = {"pose": 12, "jacobian": 6 * dof, "rate": 6 * dof, "mass": dof * dof, "torque": dof}
        assert ours.shape[1] == sum(sizes.values()), "the exchange has another layout"
        worst = dict.fromkeys(sizes, 0.0)
        for row, state in zip(ours, block):
            q, qd, qdd = np.split(state, 3)
            at = 0
            for name, expected in reference.answer(q, qd, qdd).items():
                got = row[at : at + sizes[name]]
                at += sizes[name]
                error = np.abs(got - expected).max() / max(1.0, np.abs(expected).max())
                # Written so that a NaN counts as the worst.
                worst[name] = error if not error <= worst[name] else worst[name]
    return {"tip": reference.tip, "dof": dof, **worst}


def fixture(program: list[str]) -> None:
    folder = HERE.parent / "tests/fixtures"
    sources = [(HERE.parent / "assets/ogg-arm-6.urdf", "tool0"), (folder / "tree.urdf", "l4")]
    cases = []
    for urdf, tip in sources:
        names = names_of(program, urdf)
        reference = Reference(urdf, names, tip)
        rows = []
        for state in states(reference, names, 20, seed=7):
            q, qd, qdd = np.split(state, 3)
            answer = {name: values.tolist() for name, values in reference.answer(q, qd, qdd).items()}
            rows.append({"q": q.tolist(), "qd": qd.tolist(), "qdd": qdd.tolist(), **answer})
        cases.append({"urdf": urdf.name, "tip": tip, "names": names, "states": rows})
    text = json.dumps(cases, indent=None, separators=(",", ":")) + "\n"
    (folder / "pinocchio.json").write_text(text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    (folder / "origin.toml").write_text(
        f'[pinocchio]\nfile = "pinocchio.json"\ntool = "Pinocchio (PyPI pin)"\nversion = "{pin.__version__}"\n'
        'command = "python crates/kin/benches/pinocchio_check.py --fixture"\nseed = 7\n'
        f'sha256 = "{digest}"\nlength = {len(text.encode())}\n'
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--fixture", action="store_true")
    arguments = parser.parse_args()
    program = exchange()
    if arguments.fixture:
        return fixture(program)
    folder, failed = robots_folder(), False
    print(f"Pinocchio {pin.__version__}, {arguments.states} random states per robot, largest relative difference")
    for path, tip in ROBOTS:
        result = check(program, folder / path, tip, arguments.states)
        columns = "  ".join(f"{name} {result[name]:.1e}" for name in ("pose", "jacobian", "rate", "mass", "torque"))
        good = all(result[name] <= TOLERANCE for name in ("pose", "jacobian", "rate", "mass", "torque"))
        failed |= not good
        print(f"{pathlib.Path(path).stem:12} {result['dof']:2} joints to {result['tip']:24} {columns}", flush=True)
    if failed:
        sys.exit(f"a difference exceeds {TOLERANCE}")


if __name__ == "__main__":
    main()
