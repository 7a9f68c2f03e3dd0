"""Judges for benchmarks/published_files.py: what others make of a file, beside a robot.

MuJoCo says M, h, springs and dampers, a, gaps of loops by `MujocoBridge.compare`; rows of loops and
couplings are compared here, all together, by their rank. Its own compiler reads MJCF and URDF, and
refuses inertias that no solid has: those of a URDF are put in afterwards.
"""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from published_sdf import PRODUCTS, Drawn, Unread, moved, stand_in, weigh

import condyn_pin as cp
from condyn_pin._core._pin import dry_friction
from condyn_pin.constraints import Coupling, Loop
from condyn_pin.io.mjcf_file import compiled
from condyn_pin.io.xml import open_xml

STATES, AGREES = 3, 1e-8  # measured: 2e-10 and better
OPEN = 1e-8  # of loops [m, rad]
NO_NUMBER = 1e9  # beyond it a limit is none


def compared(robot: cp.Robot, path: Path, model: str | None) -> tuple[str, float, list[str]]:
    """Return the judge, the worst difference of what agrees, and what differs."""
    if path.suffix == ".xml":
        try:
            return _beside_mujoco(robot, mujoco.MjModel.from_xml_path(str(path)), "MuJoCo")
        except ValueError:  # a mesh that only draws is not there
            return _beside_mujoco(robot, compiled(path)[0], "MuJoCo without lost meshes")
    try:
        if path.suffix == ".sdf":
            mj = Drawn(path, model or "").mujoco(robot.joints, robot.model.gravity.linear)
            return _beside_mujoco(robot, mj, "MuJoCo by published_sdf")
        return _beside_mujoco(robot, _urdf(robot, path), "MuJoCo")
    except (ValueError, KeyError, cp.CondynError) as error:
        raise Unread(" ".join(str(error).split())) from error


def _urdf(robot: cp.Robot, path: Path) -> Any:
    """Return MuJoCo's reading of a URDF, with a site and an equality for the ends of each loop."""
    spec = mujoco.MjSpec.from_string(_bare(path))
    links = {joint.get("name"): child.get("link", "") for joint in open_xml(path).iter("joint")
             if (child := joint.find("child")) is not None}  # fmt: skip
    for loop in robot.loops:
        if not (isinstance(loop, Loop) and loop.called in ("ball", "weld")):
            continue
        for frame in (loop.frame_a, loop.frame_b):
            body = links.get(frame, frame)
            if spec.body(body) is None:
                break
            spec.body(body).add_site(name=frame)
        else:
            welds = loop.called == "weld"
            made = spec.add_equality(
                name=loop.name, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=loop.frame_a,
                type=mujoco.mjtEq.mjEQ_WELD if welds else mujoco.mjtEq.mjEQ_CONNECT,
                name2=loop.frame_b,
            )  # fmt: skip
            made.data[10] = 1.0  # else turns stay free
    masses = {link.get("name", ""): link.find("inertial") for link in open_xml(path).iter("link")}
    heavy = {name: body for name in masses if (body := spec.body(name)) is not None}
    for body in heavy.values():
        stand_in(body)
    made = spec.compile()
    for name in heavy:
        weigh(made, name, *_inertial(masses[name]))
    mujoco.mj_setConst(made, mujoco.MjData(made))
    return made


def _inertial(element: ET.Element | None) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the mass of a link of a URDF, its pose (4, 4), and the tensor there (3, 3)."""
    said, mass = (None if element is None else element.find(tag) for tag in ("inertia", "mass"))
    if element is None or said is None or mass is None:
        return 0.0, np.eye(4), np.zeros((3, 3))
    origin = element.find("origin")
    pose = ET.Element("pose")
    if origin is not None:
        pose.text = f"{origin.get('xyz', '0 0 0')} {origin.get('rpy', '0 0 0')}"
    tensor = np.zeros((3, 3))
    for i, j in PRODUCTS:
        tensor[i, j] = tensor[j, i] = float(said.get(f"i{'xyz'[i]}{'xyz'[j]}", 0.0))
    return float(mass.get("value", 0.0)), moved(pose), tensor


def _beside_mujoco(robot: cp.Robot, mj: Any, judge: str) -> tuple[str, float, list[str]]:
    bridge = cp.study.MujocoBridge(robot, mj)
    worst, found, rng = 0.0, dict[str, str](), np.random.default_rng(0)
    for q in _configurations(robot, rng):
        v, tau = rng.normal(size=(2, robot.nv))
        check = bridge.compare(q, v, tau)
        terms = [term for term in check.terms if term.term != "J"]
        for term in terms:
            if term.error <= AGREES:
                worst = max(worst, term.error)
            else:
                text = f"{term.term} of {term.where}: {term.here} here, {term.there}"
                found.setdefault(term.term, text)
        found |= {cause: cause for cause in check.causes if "armature" in cause or "mass" in cause}
        if (robot.loops or mj.neq) and (said := _rows(robot, bridge, q)):
            if said.startswith("J"):
                found["J"] = said
            elif said not in judge:
                judge += f", {said}"
    return judge, worst, [*found.values(), *_bounds(robot, bridge)]


def _rows(robot: cp.Robot, bridge: Any, q: np.ndarray) -> str:
    """Return what differs between the rows of all equalities, as far as they can be compared."""
    scene = cp.Scene(robot, robot.loops)
    work, mj = cp.Workspace(scene), bridge.model
    data = mujoco.MjData(mj)
    data.qpos[:], _ = bridge.to_mujoco(q, np.zeros(robot.nv))
    mujoco.mj_forward(mj, data)
    J = np.zeros((data.nefc, mj.nv))
    if mujoco.mj_isSparse(mj):
        mujoco.mju_sparse2dense(J, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr,
                                data.efc_J_colind)  # fmt: skip
    else:
        J[:] = data.efc_J.reshape(-1, mj.nv)
    ties = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    theirs, ours = J[ties] @ bridge.velocity_map(q), work.jacobian(q)
    if np.abs(work.violation(q)).max(initial=0.0) > OPEN:
        return "loops open, rows not judged"
    if len(ours) and not len(theirs):
        return "loops not judged"
    if np.abs(data.efc_pos[ties]).max(initial=0.0) > 10 * OPEN:
        return f"J: closed here, open by {np.abs(data.efc_pos[ties]).max():.2g} in MuJoCo"
    ranks = [int(np.linalg.matrix_rank(rows, tol=1e-7 * max(np.abs(rows).max(initial=0.0), 1e-9)))
             for rows in (ours, theirs, np.vstack((ours, theirs)))]  # fmt: skip
    return (
        "" if len(set(ranks)) == 1 else "J has rank {} here, {} in MuJoCo, {} both".format(*ranks)
    )


def _bounds(robot: cp.Robot, bridge: Any) -> list[str]:
    """Return limits and dry friction that are not those of MuJoCo; tendons may narrow ours."""
    mj, found, narrower = bridge.model, [], bridge.model.ntendon > 0
    friction = dry_friction(robot.model)
    for pair in bridge.pairs:
        if pair.kind not in ("hinge", "slide"):
            continue
        theirs = [-np.inf, np.inf]
        if mj.jnt_limited[pair.there]:
            theirs = [x if abs(x) < NO_NUMBER else s * np.inf for x, s in zip(
                mj.jnt_range[pair.there], (-1, 1), strict=True)]  # fmt: skip
        if pair.q.stop - pair.q.start == 1:
            ends = (robot.model.lowerPositionLimit, robot.model.upperPositionLimit)
            ours = [float(end[pair.q.start]) for end in ends]
            ours = [x if abs(x) < NO_NUMBER else np.sign(x) * np.inf for x in ours]
            inside = narrower and ours[0] >= theirs[0] and ours[1] <= theirs[1]
            fixed = ours[0] == ours[1] and not mj.jnt_limited[pair.there]
            if not (inside or fixed or np.allclose(ours, theirs, rtol=1e-9, atol=1e-9)):
                found.append(f"limits of {pair.name}: {ours} here, {theirs}")
        rubs = float(mj.dof_frictionloss[pair.dof.start])
        if abs(friction[pair.v.start] - rubs) > 1e-12 and not narrower:
            found.append(f"friction of {pair.name}: {friction[pair.v.start]} here, {rubs}")
    return found


def _configurations(robot: cp.Robot, rng: np.random.Generator) -> list[np.ndarray]:
    """Return random q on the loops; where they cannot be closed, q off them."""
    found, start = [], robot.postures.get("qpos0", pin.neutral(robot.model))
    for _ in range(STATES):
        q = pin.integrate(robot.model, start, rng.normal(size=robot.nv))
        if robot.loops:
            with contextlib.suppress(cp.CondynError):
                q = cp.Scene(robot, robot.loops).sample(rng)[0]
        found.append(q)
    return found


def _bare(path: Path) -> str:
    """Return a URDF without shapes and without what else MuJoCo would read."""
    root = open_xml(path)
    for element in [root, *root.iter("link")]:
        for tag in ("visual", "collision", "transmission", "gazebo", "mujoco"):
            for part in element.findall(tag):
                element.remove(part)
    settings = {"fusestatic": "false", "inertiafromgeom": "false"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", settings)
    return ET.tostring(root, encoding="unicode")


def sums(robot: cp.Robot, path: Path, why: str) -> tuple[str, float, list[str]]:
    """Return how masses and gravity compare with the numbers in the file."""
    judge = f"sums; {why[:60]}"
    if path.suffix == ".xml":
        return judge, 0.0, []
    links = [link for link in open_xml(path).iter("link") if "name" in link.attrib]
    masses = [float((m.get("value") or m.text or "0") if (m := x.find("inertial/mass")) is not None
                    else path.suffix == ".sdf") for x in links]  # fmt: skip
    if path.suffix == ".sdf" and len(list(open_xml(path).iter("model"))) > 1:
        return judge, 0.0, []  # which of them are the robot's, that reader did not find
    off = abs(sum(Y.mass for Y in robot.model.inertias) - sum(masses)) / max(sum(masses), 1.0)
    return judge, off, [f"mass by {off:.1e}"] if off > 1e-9 else []


def mimics(robot: cp.Robot, path: Path) -> list[str]:
    """Return couplings that are not those of the file."""
    wanted = Counter(
        (
            joint.get("name"),
            m.get("joint"),
            float(m.get("multiplier", 1)),
            float(m.get("offset", 0)),
        )
        for joint in open_xml(path).findall("joint")
        if (m := joint.find("mimic")) is not None and joint.get("type") != "fixed"
    )
    had = Counter((c.joint_a, c.joint_b, c.ratio, c.offset)
                  for c in robot.loops if isinstance(c, Coupling))  # fmt: skip
    return [f"mimic {one}" for one in (wanted - had)]
