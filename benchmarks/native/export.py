"""Write a scene for ``condyn_native``: one directory, two text files.

``model.txt`` is Pinocchio's own text archive of the model; only the version that wrote it reads it.

``scene.txt`` holds words and numbers, separated by white space::

    condyn_scene 1                     the format's version
    pinocchio 4.1.0                    the version that wrote model.txt
    constraints 2
    6 7 R p 0 R p                      rows (3 or 6), joint 1 and its placement, joint 2 and its
    3 13 R p 5 R p                     placement; R has 9 numbers, row by row, p has 3
    q 39 ...                           a length and that many numbers
    v 38 ...
    tau 38 ...

Numbers have 17 digits, so nothing is lost.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

FORMAT_VERSION = 1


def export_scene(
    directory: Path,
    name: str,
    model: pin.Model,
    constraints: Sequence[pin.RigidConstraintModel],
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
) -> Path:
    """Write ``directory/name`` and return it.

    The constraints must be LOCAL with the moving joint first, the form in which every method of
    Pinocchio is right. Baumgarte gains are not written: the program measures J a + gamma = 0.
    """
    for constraint in constraints:
        _check(constraint)
    scene = Path(directory) / name
    scene.mkdir(parents=True, exist_ok=True)
    model.saveToText(str(scene / "model.txt"))
    lines = [
        f"condyn_scene {FORMAT_VERSION}",
        f"pinocchio {pin.__version__}",
        f"constraints {len(constraints)}",
        *map(_constraint, constraints),
        _vector("q", q, model.nq),
        _vector("v", v, model.nv),
        _vector("tau", tau, model.nv),
    ]
    (scene / "scene.txt").write_text("\n".join(lines) + "\n", encoding="ascii")
    return scene


def _check(constraint: pin.RigidConstraintModel) -> None:
    if constraint.reference_frame != pin.ReferenceFrame.LOCAL:
        raise ValueError(f"constraint {constraint.name!r} is not LOCAL")
    if constraint.joint1_id == 0:
        raise ValueError(f"constraint {constraint.name!r} has the world as its first joint")


def _constraint(constraint: pin.RigidConstraintModel) -> str:
    rows = 6 if constraint.type == pin.ContactType.CONTACT_6D else 3
    return " ".join(
        [
            str(rows),
            str(constraint.joint1_id),
            _placement(constraint.joint1_placement),
            str(constraint.joint2_id),
            _placement(constraint.joint2_placement),
        ]
    )


def _placement(placement: pin.SE3) -> str:
    return _numbers(np.concatenate([placement.rotation.ravel(), placement.translation]))


def _vector(name: str, values: np.ndarray, size: int) -> str:
    values = np.asarray(values, dtype=float)
    if values.shape != (size,) or not np.isfinite(values).all():
        raise ValueError(f"{name} must be {size} finite numbers, got {values!r}")
    return f"{name} {size} {_numbers(values)}"


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.17g}" for value in values)
