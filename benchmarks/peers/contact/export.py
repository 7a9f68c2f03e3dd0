"""The contact scenes, where their bodies have to be, and their files for the peers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.constraints import Ball, Box
from condyn_pin.simulation.records import gaps_along
from peers.contact.scene import ContactScene

GRAVITY = 9.81  # [m/s^2]
STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4)  # [s]

# The tower: half of an edge [m], and how many boxes.
HALF, BOXES = 0.1, 5

# Solo12: radius of its feet [m], springs and dampers that hold its legs, steps of its truth.
FOOT, STIFFNESS, DAMPING = 0.016, 8.0, 0.2  # [m, N m/rad, N m s/rad]
FINE = 2e-5  # [s]


@dataclass(frozen=True, eq=False)
class Motion:
    """A scene, a state that it starts from, and where its floating bodies have to be.

    `truth()` is (times, bodies, 3), their centres of mass [m]; `error` says what is measured.
    """

    name: str
    error: str
    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    times: np.ndarray
    truth: Callable[[], np.ndarray]
    steps: tuple[float, ...] = STEPS

    def centres(self, q: np.ndarray) -> np.ndarray:
        """Return the centres of mass of bodies on floating bases (bodies, 3) [m]."""
        model = self.scene.robot.model
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        floating = [i for i in range(1, model.njoints) if model.joints[i].nq == 7]
        return np.array([data.oMi[i].act(model.inertias[i].lever) for i in floating])


def motions() -> tuple[Motion, ...]:
    """Return all of them."""
    return sliding(), tower(0.0), tower(0.01), bouncing(), landing()


def sliding(*, mu: float = 0.5, speed: float = 1.0, heading: float = 0.3) -> Motion:
    """Return a box that slides and stops after v^2 / (2 mu g)."""
    contact = cp.FrictionalContact("box", Box(HALF, HALF, HALF), friction=mu)
    scene = cp.Scene(cp.model.free_box(), contacts=[contact])
    q, v = scene.state("resting")
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    v[:3] = speed * along
    times = _times(0.05, 8)

    def truth() -> np.ndarray:
        s = np.minimum(times, speed / (mu * GRAVITY))
        return (q[:3] + np.outer(speed * s - mu * GRAVITY * s**2 / 2, along))[:, None]

    error = "largest distance of its middle from the closed form, every 50 ms to 0.4 s"
    return Motion("sliding box", error, scene, q, v, times, truth)


def tower(height: float, *, mu: float = 0.5) -> Motion:
    """Return boxes on each other that fall from a height, and rest."""
    names = [f"b{i}" for i in range(BOXES)]
    boxes = cp.model.together({name: cp.model.free_box() for name in names})
    shape = Box(HALF, HALF, HALF)
    contacts = [cp.FrictionalContact("b0/box", shape, friction=mu)]
    contacts += [
        cp.FrictionalContact(f"b{i}/box", shape, on=f"b{i - 1}/box", on_shape=shape, friction=mu)
        for i in range(1, BOXES)
    ]
    scene = cp.Scene(boxes, contacts=contacts)
    q, v = scene.state()
    rest = np.array([[0.0, 0.0, HALF * (2 * i + 1)] for i in range(BOXES)])
    for i in range(BOXES):
        q[7 * i : 7 * i + 3] = rest[i] + (0.0, 0.0, height)
    name = f"tower dropped {1e2 * height:g} cm" if height else "tower at rest"
    error = "largest distance of a box from where it has to rest, after 1 s"
    return Motion(name, error, scene, q, v, np.array([1.0]), lambda: rest[None], STEPS[:4])


def bouncing(*, e: float = 0.8, height: float = 0.5, radius: float = 0.05) -> Motion:
    """Return a ball that falls, and comes back with e of its speed."""
    contact = cp.FrictionalContact("ball", Ball(radius), friction=0.2, restitution=e)
    scene = cp.Scene(cp.model.free_ball(radius=radius), contacts=[contact])
    q, v = scene.state()
    q[2] = radius + height
    times = _times(0.05, 20)

    def truth() -> np.ndarray:
        hit, up = np.sqrt(2 * height / GRAVITY), np.sqrt(2 * GRAVITY * height)
        z = height - GRAVITY * times**2 / 2
        while hit < times[-1]:
            up, s = e * up, times - hit
            z, hit = np.where(s > 0, up * s - GRAVITY * s**2 / 2, z), hit + 2 * up / GRAVITY
        return np.column_stack((0 * times, 0 * times, radius + z))[:, None]

    error = "largest distance of its middle from the closed form, every 50 ms to 1 s"
    return Motion("bouncing ball", error, scene, q, v, times, truth)


def landing(*, mu: float = 0.7, height: float = 0.05) -> Motion:
    """Return Solo12 that lands on legs held by springs and dampers in its joints."""
    solo = cp.load_robot("solo12")
    model, q = pin.Model(solo.model), np.array(solo.postures["standing"])
    model.damping[6:] = DAMPING
    springs = [
        cp.model.Spring(model.names[i], STIFFNESS, float(q[model.joints[i].idx_q]))
        for i in range(2, model.njoints)
    ]
    held = replace(solo, model=model, springs=springs)
    feet = [cp.FrictionalContact(c.frame, Ball(FOOT), friction=mu) for c in solo.contacts]
    scene = cp.Scene(held, contacts=feet)
    v, times = np.zeros(model.nv), _times(0.05, 10)
    q[2] += height - float(gaps_along(scene, q[None])[1].min())
    error = f"largest distance of its base from Moreau's at dt {FINE:g} s, every 50 ms to 0.5 s"
    motion = Motion("Solo12 lands", error, scene, q, v, times, lambda: fine(motion, cp.Moreau()))
    return motion


def fine(motion: Motion, scheme: cp.simulation.ContactScheme) -> np.ndarray:
    """Return where the bodies are at the times, in fine steps."""
    run = cp.simulate(
        motion.scene, motion.q, motion.v, duration=float(motion.times[-1]), dt=FINE,
        integrator=scheme, record=round(float(motion.times[0]) / FINE),
    )  # fmt: skip
    return np.array([motion.centres(q) for q in run.q[1:]])


def export(motion: Motion, folder: Path) -> ContactScene:
    """Write the files of a motion, and return it as peers read it."""
    contact = motion.scene.contacts[0]
    told = ContactScene(
        name=motion.name, error=motion.error, bodies=_floating(motion.scene.robot),
        times=tuple(motion.times.tolist()), truth=motion.truth().tolist(), steps=motion.steps,
        friction=contact.friction, restitution=contact.restitution,
        folder=folder / motion.name.replace(" ", "_"),
    )  # fmt: skip
    told.save(mjcf(motion))
    return told


def mjcf(motion: Motion) -> str:
    """Return the robot with a floor, the shapes of its contacts, and the start as a keyframe."""
    tree = ET.fromstring(motion.scene.robot.to_mjcf())
    friction = f"{motion.scene.contacts[0].friction} 0 0"
    about = {"friction": friction, "condim": "3"}
    world = tree.find("worldbody")
    assert world is not None
    ET.SubElement(world, "geom", {"name": "floor", "type": "plane", "size": "5 5 1"} | about)
    owners = {site.get("name"): (body, site) for body in tree.iter("body") for site in body}
    for contact in motion.scene.contacts:
        body, site = owners[contact.frame]
        round_ = isinstance(contact.shape, Ball)
        s = contact.shape
        size = (s.radius,) if round_ else (s.x, s.y, s.z)
        made = {
            "name": contact.name, "type": "sphere" if round_ else "box",
            "size": " ".join(f"{x:g}" for x in size), "mass": "0", "pos": site.get("pos", "0 0 0"),
        }  # fmt: skip
        ET.SubElement(body, "geom", made | about)
    return with_start(tree, motion.scene.robot, motion.q, motion.v)


def with_start(tree: ET.Element, robot: cp.Robot, q: np.ndarray, v: np.ndarray) -> str:
    """Return a file of a robot with a state as its only keyframe."""
    import mujoco

    for old in tree.findall("keyframe"):
        tree.remove(old)
    model = mujoco.MjModel.from_xml_string(ET.tostring(tree, encoding="unicode"))
    bridge = cp.study.MujocoBridge(robot, model)
    qpos, qvel = (" ".join(map(repr, x.tolist())) for x in bridge.to_mujoco(q, v))
    start = ET.SubElement(tree, "keyframe")
    ET.SubElement(start, "key", {"name": "start", "qpos": qpos, "qvel": qvel})
    ET.indent(tree)
    return ET.tostring(tree, encoding="unicode")


def _floating(robot: cp.Robot) -> tuple[str, ...]:
    """Return the names that `to_mjcf` gives to bodies on floating bases."""
    tree = ET.fromstring(robot.to_mjcf())
    named = (body for body in tree.iter("body") if _is_free(body))
    return tuple(str(body.get("name")) for body in named)


def _is_free(body: ET.Element) -> bool:
    joint = body.find("joint")
    return joint is not None and joint.get("type") == "free"


def _times(every: float, count: int) -> np.ndarray:
    return every * np.arange(1, count + 1)
