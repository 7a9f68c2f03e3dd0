"""Newton's Kamino: hard contacts with Coulomb's law by a proximal ADMM, in single precision.

Made for many robots on a graphics card; here it is one, on the processor. It knows restitution.
Springs and dampers of joints are the gains of motors, which it takes at the end of the step.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import newton
import numpy as np
import warp as wp
from newton.solvers import SolverKamino

from peers.contact.harness import Played, Way, main, played
from peers.contact.scene import ContactScene

INTEGRATORS = ("euler", "moreau")
ALPHA = 0.01  # share of an open joint that a step closes: Kamino's default [1]
SHORTEST = 2e-3  # smaller steps take minutes [s]


def ways(scene: ContactScene) -> list[Way]:
    """Return both integrators, with the steps that take no minutes."""
    return [way(scene, kind, dt) for kind in INTEGRATORS for dt in scene.steps if dt >= SHORTEST]


def way(scene: ContactScene, integrator: str, dt: float) -> Way:
    """Return an integrator."""
    kamino = Kamino(read(scene.model), integrator, dt, scene.restitution)
    bodies = [kamino.body(name) for name in scene.bodies]

    def play() -> Played:
        kamino.start()
        return played(scene, dt, kamino.advance, lambda: kamino.centres()[bodies])

    return Way(f"Kamino, {integrator}", dt, play)


def read(path: Path) -> newton.ModelBuilder:
    """Return a file of MuJoCo's, its springs as motors, at its keyframe; loops are left open."""
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
    SolverKamino.register_custom_attributes(builder)
    builder.default_shape_cfg.margin = builder.default_shape_cfg.gap = 0.0
    builder.add_mjcf(str(path), parse_sites=False, enable_self_collisions=True)
    text = ET.parse(path)
    place(builder, text)
    hold(builder, text)
    return builder


class Kamino:
    """A robot in Kamino, with its own search for contacts: Newton's takes 35 ms."""

    def __init__(
        self,
        robot: newton.ModelBuilder,
        integrator: str,
        dt: float,
        restitution: float = 0.0,
        alpha: float = ALPHA,
    ) -> None:
        self._dt = dt
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        builder.add_world(robot)
        self.model = builder.finalize()
        self.model.shape_material_restitution.fill_(restitution)
        config = SolverKamino.Config.from_model(self.model)
        config.use_collision_detector, config.integrator = True, integrator
        config.constraints.alpha = alpha
        self._solver = SolverKamino(self.model, config=config)
        self._control = self.model.control()
        self._contacts = newton.CollisionPipeline(self.model).contacts()
        self.start()

    def start(self) -> None:
        """Go back to the start."""
        self.now, self._next = self.model.state(), self.model.state()
        self._solver.reset(state=self.now)
        newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.now)

    def advance(self, count: int) -> None:
        """Take some steps."""
        for _ in range(count):
            self.now.clear_forces()
            self._solver.step(self.now, self._next, self._control, self._contacts, self._dt)
            self.now, self._next = self._next, self.now

    def body(self, name: str) -> int:
        """Return the number of a body."""
        return next(i for i, label in enumerate(self.model.body_label) if last(label, name))

    def centres(self) -> np.ndarray:
        """Return the centres of mass of all bodies (bodies, 3) [m]."""
        poses, levers = self.now.body_q.numpy(), self.model.body_com.numpy()
        return np.array([p[:3] + turned(p[3:], c) for p, c in zip(poses, levers, strict=True)])


def last(label: str, name: str) -> bool:
    """Whether a label, a path of names, ends with a name."""
    return f"/{label}".endswith(f"/{name}")


def turned(quaternion: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return a vector that a quaternion x y z w turns."""
    u, w = quaternion[:3], quaternion[3]
    return x + 2 * np.cross(u, np.cross(u, x) + w * x)


def place(builder: newton.ModelBuilder, text: ET.ElementTree) -> None:
    """Start at the keyframe, whose quaternions are w x y z; all bodies start without a turn."""
    key = text.find("keyframe/key")
    assert key is not None
    q, v = (np.array(key.attrib[name].split(), dtype=float) for name in ("qpos", "qvel"))
    for i, kind in enumerate(builder.joint_type):
        if kind == newton.JointType.FREE:
            k = builder.joint_q_start[i]
            q[k + 3 : k + 7] = np.roll(q[k + 3 : k + 7], -1)
    builder.joint_q, builder.joint_qd = q.tolist(), v.tolist()


def hold(builder: newton.ModelBuilder, text: ET.ElementTree) -> None:
    """Make motors of springs and dampers in joints."""
    springs = [joint for joint in text.iter("joint") if joint.get("stiffness")]
    for joint in springs:
        labels = enumerate(builder.joint_label)
        i = next(i for i, label in labels if last(label, joint.attrib["name"]))
        q, v = builder.joint_q_start[i], builder.joint_qd_start[i]
        builder.joint_target_mode[v] = int(newton.JointTargetMode.POSITION_VELOCITY)
        builder.joint_target_ke[v] = float(joint.attrib["stiffness"])
        builder.joint_target_kd[v] = float(joint.get("damping", 0))
        builder.joint_target_q[q] = float(joint.attrib["springref"])
        builder.joint_damping[v] = 0.0


if __name__ == "__main__":
    wp.config.quiet = True
    main("Newton", newton.__version__, ways)
