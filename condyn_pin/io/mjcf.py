"""Read a robot from an MJCF file, with MuJoCo's meaning of it.

Two routes lead to one description of the file (`mjcf_types`), and one builder makes a Pinocchio
model of it (`mjcf_build`):

    plain      `mjcf_plain` reads the XML itself: bodies with an explicit <inertial>
    compiled   `mjcf_compiled` lets MuJoCo read the file, where its compiler is needed: inertia
               that follows from geoms, attached and replicated parts

The other files: `mjcf_words` has the words of the format, `mjcf_xml` and `mjcf_pose` read numbers
and orientations, `mjcf_include` and `mjcf_defaults` other files and default classes,
`mjcf_equality` loops. The format: https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from condyn_pin.errors import CondynError, InvalidModel
from condyn_pin.io.mjcf_build import build
from condyn_pin.io.mjcf_compiled import read_compiled
from condyn_pin.io.mjcf_include import insert_includes, parse
from condyn_pin.io.mjcf_plain import read_plain
from condyn_pin.io.mjcf_types import MjcfRobot
from condyn_pin.io.mjcf_xml import NotPlain
from condyn_pin.io.xml import check_counts

__all__ = ["MjcfRobot", "read_mjcf"]


def read_mjcf(path: str | PathLike[str]) -> MjcfRobot:
    """Read an MJCF file into a Pinocchio model and its loops, the same with every Pinocchio.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    MjcfRobot
        The model, its loops and couplings, motors, springs, the keyframes as postures (the last
        one is ``qpos0``, in which the file draws the model), and what is not used.

    Raises
    ------
    InvalidModel
        The file cannot be read, or what it says cannot be made a model.
    MissingExtra
        The file needs MuJoCo's compiler, and MuJoCo is not installed.

    Notes
    -----
    A body, a site and a joint are frames of their names; where several share a name it is the
    body's, then the site's. A <connect> or <weld> without sites makes the frames ``NAME_a`` and
    ``NAME_b``. Loops are rigid here, whatever their solref and solimp.
    """
    path = Path(path)
    root = parse(path)
    try:
        if root.tag != "mujoco":
            raise InvalidModel(f"its root element is <{root.tag}>, an MJCF has <mujoco>")
        insert_includes(root, path.parent)
        check_counts(sum(1 for _ in root.iter("body")), 0)
        try:
            said = read_plain(root)
        except NotPlain as reason:
            said = read_compiled(path, str(reason))
        return build(said)
    except CondynError as error:
        error.args = (f"{path}: {error}",)
        raise
