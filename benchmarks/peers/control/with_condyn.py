"""condyn_pin: loops and torques eliminated, wrench cones, ProxQP behind the last active set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.contact import WrenchCone
from condyn_pin.control import CenterOfMass, Controller, Orientation, Posture
from condyn_pin.dynamics.solution import Sites
from peers.control.harness import Contender, main
from peers.control.question import Question, Wish


def talos(effort: np.ndarray | None = None) -> cp.Scene:
    """Return Talos on both feet, with motors of other limits."""
    robot = cp.load_robot("talos")
    if effort is not None:
        model = pin.Model(robot.model)
        model.effortLimit = effort
        robot = replace(robot, model=model)
    return cp.Scene(robot, robot.contacts)


def controller_of(scene: cp.Scene, question: Question, engine: str) -> Controller:
    """Return the controller of a question; its friction cones are the pyramids of the others."""
    wish = question.wish
    tasks = [
        CenterOfMass(reference=question.com, kp=wish.com_kp, weight=wish.com_weight),
        Orientation("base_link", kp=wish.trunk_kp, weight=wish.trunk_weight),
        Posture(kp=wish.posture_kp, weight=wish.posture_weight),
    ]
    cones = WrenchCone(wish.friction, pyramid="outer")
    return Controller(scene, tasks, cones=cones, engine=engine)


def question_of(urdf: str, count: int) -> Question:
    """Return the question: states of a slow motion in steps of 1 ms, which keeps the feet."""
    scene = talos()
    robot = scene.robot
    q, v = scene.state()
    data = robot.model.createData()
    com = np.array(pin.centerOfMass(robot.model, data, q))
    way = np.random.default_rng(0).normal(size=robot.nv)
    home, Q, V = q, [], []
    for k in range(count):
        v = cp.mechanism.project_velocity(scene, q, 0.1 * np.sin(0.05 * k) * way)
        Q.append(q)
        V.append(v)
        q = pin.integrate(robot.model, q, 1e-3 * v)
    foot = robot.contacts[0]
    return Question(
        urdf, "base_link", [each.name for each in robot.contacts], foot.half_length,
        foot.half_width, home, com, np.array(robot.model.armature),
        np.array(robot.model.effortLimit), np.array(Q), np.array(V), Wish(),
    )  # fmt: skip


def active(first: Question) -> list[Question]:
    """Return the same robot at rest, its mass drawn away until floor or motors give no more."""

    def drawn(title: str, way: tuple[float, ...], effort: float = 1.0, **wish: float) -> Question:
        asked = replace(first.wish, **wish)
        return replace(
            first, title=title, com=first.com + np.array(way) / asked.com_kp,
            effort=effort * first.effort, q=first.q[:1], v=0 * first.v[:1], wish=asked,
        )  # fmt: skip

    return [
        drawn("forwards by 3 m/s^2: soles tip", (3.0, 0.0, 0.0)),
        drawn("sideways by 3 m/s^2, friction 0.2: feet slip", (0.0, 3.0, 0.0), friction=0.2),
        drawn("up by 5 m/s^2, a fifth of the torque: motors end", (0.0, 0.0, 5.0), 0.2),
        drawn("aside, up, a quarter of the torque: all three", (2.0, 3.0, 5.0), 0.25, friction=0.2),
        drawn("down by 11 m/s^2, as an equation: no answer", (0.0, 0.0, -11.0), com_weight=np.inf),
    ]


def contender(question: Question, engine: str = "python") -> Contender:
    """Return ours at work, in Python or in the compiled core; the proof is part of the tick."""
    scene = talos(question.effort)
    controller = controller_of(scene, question, engine)

    def tick(i: int) -> float:
        out = controller.solve(question.q[i], question.v[i])
        return out.solve_time

    def answer(i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        out = controller.solve(question.q[i], question.v[i])
        if not out.status.ok:
            raise ValueError(f"state {i}: {out.infeasible or out.status}")
        return out.a, out.tau, Sites(scene, question.q[i]).jacobian.T @ out.lam

    n, p, r = controller.program(question.q[0], question.v[0]).sizes
    size = f"{n} unknowns, {p} equations, {r} inequalities"
    return Contender(tick, answer, size, "with the proof of each answer")


if __name__ == "__main__":
    main("condyn_pin", cp.__version__, contender)
