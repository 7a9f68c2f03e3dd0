"""The words of MJCF that the plain reader knows: what it reads, what it reports, what it passes by.

An attribute or an element that stands nowhere here is not plain: MuJoCo itself has to read it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

ORIENTATIONS: Final = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
POSE: Final = frozenset({"pos", *ORIENTATIONS})
EQUALITIES: Final = ("connect", "weld", "equality/joint")
_SOFT: Final = frozenset({"solref", "solimp"})
_LOOP: Final = frozenset({"name", "class", "active", "body1", "body2", "anchor", "site1", "site2"})

# Attributes that are read.
READ: Final[Mapping[str, frozenset[str]]] = {
    "mujoco": frozenset({"model"}),
    "compiler": frozenset({"angle", "autolimits", "eulerseq"}),
    "option": frozenset({"gravity"}),
    "flag": frozenset({"gravity", "equality"}),
    "body": frozenset({"name", "childclass"}) | POSE,
    "inertial": frozenset({"mass", "diaginertia", "fullinertia"}) | POSE,
    "joint": frozenset(
        {"name", "class", "type", "pos", "axis", "ref", "range", "limited"}
        | {"armature", "damping", "stiffness", "springref"}
    ),
    "freejoint": frozenset({"name"}),
    "site": frozenset({"name", "class"}) | POSE,
    "connect": _LOOP,
    "weld": _LOOP | {"relpose", "torquescale"},
    "equality/joint": frozenset({"name", "class", "active", "joint1", "joint2", "polycoef"}),
    "key": frozenset({"name", "qpos"}),
}

# Attributes that have a meaning which is not used: counted and reported.
REPORTED: Final[Mapping[str, frozenset[str]]] = {
    "option": frozenset({"wind", "magnetic", "density", "viscosity"}),
    "flag": frozenset(
        {"constraint", "limit", "frictionloss", "clampctrl", "actuation", "override"}
    ),
    "body": frozenset({"mocap", "gravcomp"}),
    "joint": frozenset(
        {"frictionloss", "margin", "solreflimit", "solimplimit", "solreffriction"}
        | {"solimpfriction", "actuatorfrcrange", "actuatorfrclimited", "actuatorgravcomp"}
    ),
    "connect": _SOFT,
    "weld": _SOFT,
    "equality/joint": _SOFT,
    "key": frozenset({"qvel", "act", "ctrl", "mpos", "mquat"}),
}

# Attributes that say nothing about the motion of rigid bodies.
SILENT: Final[Mapping[str, frozenset[str]]] = {
    "compiler": frozenset(
        {"strippath", "meshdir", "texturedir", "assetdir", "discardvisual", "usethread"}
        | {
            "fusestatic",
            "saveinertial",
            "convexhull",
            "fitaabb",
            "inertiagrouprange",
            "exactmeshinertia",
        }
    ),
    "option": frozenset(
        {"timestep", "apirate", "impratio", "tolerance", "ls_tolerance", "noslip_tolerance"}
        | {"ccd_tolerance", "mpr_tolerance", "sleep_tolerance", "o_margin", "o_solref", "o_solimp"}
        | {"o_friction", "integrator", "cone", "jacobian", "solver", "iterations", "ls_iterations"}
        | {"noslip_iterations", "ccd_iterations", "mpr_iterations", "sdf_iterations"}
        | {"sdf_initpoints", "actuatorgroupdisable"}
    ),
    "flag": frozenset(
        {"contact", "warmstart", "filterparent", "refsafe", "sensor", "midphase", "nativeccd"}
        | {
            "eulerdamp",
            "autoreset",
            "island",
            "energy",
            "fwdinv",
            "invdiscrete",
            "multiccd",
            "sleep",
        }
    ),
    "body": frozenset({"user", "sleep"}),
    "joint": frozenset({"group", "user"}),
    "freejoint": frozenset({"group"}),
    "site": frozenset({"type", "size", "group", "material", "rgba", "user"}),
    "key": frozenset({"time"}),
}

# Elements that are read, and those that have no part in the motion of rigid bodies: counted.
SECTIONS: Final = ("compiler", "option", "worldbody", "equality", "actuator", "keyframe")
PASSED_SECTIONS: Final = (
    "size", "visual", "statistic", "asset", "custom", "sensor", "contact", "tendon",
)  # fmt: skip
PASSED_IN_BODY: Final = ("geom", "camera", "light")

# Settings of <compiler> that change masses or poses, and the value with which they do not.
PLAIN_SETTINGS: Final[Mapping[str, str]] = {
    "coordinate": "local",
    "inertiafromgeom": "auto",
    "balanceinertia": "false",
    "alignfree": "false",
    "boundmass": "0",
    "boundinertia": "0",
    "settotalmass": "-1",
}
