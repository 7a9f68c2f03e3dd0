"""A Robot as a notebook shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from condyn_pin._core import show
from condyn_pin._core.arguments import counted

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot


def robot_html(robot: Robot) -> str:
    """Return what a robot is, its joints, loops, contacts, and what is not used."""
    joints = [
        (name, _kind(joint), _indices(joint.idx_q, joint.nq), _indices(joint.idx_v, joint.nv),
         "motor" if name in robot.actuated else "")
        for name, joint in zip(robot.joints, robot.model.joints[1:], strict=True)
    ]  # fmt: skip
    loops = [(loop.name, loop.title, str(loop.rows)) for loop in robot.loops]
    contacts = [(contact.name, contact.title, str(contact.rows)) for contact in robot.contacts]
    said = {
        "coordinates": f"nq {robot.nq}, nv {robot.nv}",
        "mass": f"{robot.mass:.6g} kg",
        "motors": str(len(robot.actuated)),
        "postures": ", ".join(robot.postures) or "none",
        "source": robot.source or "unknown",
        "licence": robot.licence or "unknown",
    }
    columns = ("name", "kind", "rows")
    return show.page(
        f"Robot {robot.name}",
        show.facts(said.items()),
        show.folded(
            counted(len(joints), "joint"),
            show.grid(("joint", "kind", "in q", "in v", ""), joints),
            count=len(joints),
        ),
        show.folded(counted(len(loops), "loop"), show.grid(columns, loops), count=len(loops)),
        show.folded(
            counted(len(contacts), "ready-made contact"),
            show.grid(columns, contacts),
            count=len(contacts),
        ),
        show.folded(
            "changes the motion, and is not modelled", show.notes(robot.unmodelled), count=0
        ),
        show.folded("in the file and not used", show.notes(robot.unused)),
    )


def _kind(joint: Any) -> str:
    return str(joint.shortname()).removeprefix("JointModel")


def _indices(start: int, count: int) -> str:
    return str(start) if count == 1 else f"{start}:{start + count}"
