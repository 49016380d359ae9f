"""Pinocchio's figures for the rows of `kin.rs`: one JSON document on stdout."""

import json
import pathlib
import time

import numpy as np
import pinocchio as pin

URDF = pathlib.Path(__file__).resolve().parents[1] / "assets/ogg-arm-6.urdf"
model = pin.buildModelFromUrdf(str(URDF))
data = model.createData()
frame = model.getFrameId("tool0")
random = np.random.default_rng(1)


def within() -> np.ndarray:
    return random.uniform(model.lowerPositionLimit, model.upperPositionLimit)


def microseconds(call, states, blocks: int = 100) -> float:
    times = []
    for _ in range(blocks):
        start = time.perf_counter()
        for q in states:
            call(q)
        times.append((time.perf_counter() - start) * 1e6 / len(states))
    return float(np.median(times))


def row(name: str, unit: str, figure: float, count: int, note: str) -> dict:
    return {"name": name, "unit": unit, "peer": figure, "peer_name": "Pinocchio (Python)", "n": count, "note": note}


def solve(target: pin.SE3, q: np.ndarray, iterations: int = 300) -> bool:
    """Pinocchio's own example of damped inverse kinematics, with full steps and limits."""
    for _ in range(iterations):
        pin.forwardKinematics(model, data, q)
        pose = pin.updateFramePlacement(model, data, frame)
        error = pose.actInv(target)
        step = pin.log(error).vector
        if np.linalg.norm(error.translation) < 1e-6 and np.linalg.norm(pin.log3(error.rotation)) < 1e-6:
            return True
        jacobian = -pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(model, data, q, frame)
        change = -jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), step)
        q = np.clip(pin.integrate(model, q, 0.5 * change), model.lowerPositionLimit, model.upperPositionLimit)
    return False


def main() -> None:
    states = [within() for _ in range(200)]

    def fk(q):
        pin.forwardKinematics(model, data, q)
        pin.updateFramePlacement(model, data, frame)

    def both(q):
        fk(q)
        pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)

    rows = [
        row("fk_6dof", "us", microseconds(fk, states), 200, "called from Python"),
        row("fk_jacobian_6dof", "us", microseconds(both, states), 200, "called from Python"),
        row("inverse_dynamics_6dof", "us", microseconds(lambda q: pin.rnea(model, data, q, q, q), states), 200, "called from Python"),
        row("mass_matrix_6dof", "us", microseconds(lambda q: pin.crba(model, data, q), states), 200, "called from Python"),
    ]
    times, reached, count = [], 0, 200
    for _ in range(count):
        fk(within())
        target = data.oMf[frame].copy()
        seed = within()
        start = time.perf_counter()
        if solve(target, seed):
            reached += 1
            times.append((time.perf_counter() - start) * 1e6)
    rows.append(row("ik_numeric_6dof", "us", float(np.median(times)), reached, "damped least squares, one attempt, solved cases only"))
    rows.append(row("ik_numeric_6dof_success", "%", 100.0 * reached / count, count, "damped least squares, one attempt"))
    print(json.dumps({"area": "kin", "rows": rows}))


if __name__ == "__main__":
    main()
