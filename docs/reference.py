"""The pages of the API: every public name, under the area that its module belongs to."""

from __future__ import annotations

import ast
import inspect
import re
from functools import cache, reduce
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import condyn_pin

# What a module is listed under: by the longest of these that its name begins with.
_AREAS = {
    "Robots": ("io", "model"),
    "Constraints": ("constraints",),
    "Scenes and states": (
        "dynamics.scene",
        "dynamics.nominal",
        "constraints.rows.bound",
        "mechanism",
    ),
    "Smaller scenes": (
        "mechanism.reduction",
        "mechanism.minimal_scene",
        "mechanism.suggestions",
    ),
    "Answers": ("dynamics", "constraints.forces", "constraints.rows"),
    "Friction cones": ("contact.cones",),
    "Contact problems": ("contact",),
    "Contact solvers": ("contact.solvers",),
    "Solvers": ("dynamics.solvers",),
    "Derivatives": ("dynamics.derivatives",),
    "Whole-body control": (
        "control.tasks",
        "control.qp",
        "control.distribution",
        "control.controller",
        "control.answer",
        "control.hierarchy",
        "control.limits",
        "control.balancing",
        "control.support",
    ),
    "Motors and impacts": ("control", "dynamics.impacts", "simulation.events"),
    "Simulation": (
        "simulation",
        "stepping",
        "gradients",
        "constraints.drift",
    ),
    "Nonholonomic machines": (
        "nonholonomic",
        "mechanism.controllability",
        "mechanism.classification",
    ),
    "Many states at once": ("simulation.batch", "stepping.batch", "_core.rows", "_core.work"),
    "Layers for torch and jax": ("layers",),
    "Time against error": ("study",),
    "Beside MuJoCo": ("study.mujoco",),
    "Pictures": ("viewing",),
    "Errors": ("errors",),
}
_AREA_OF = {part: area for area, parts in _AREAS.items() for part in parts}


def areas() -> dict[str, list[str]]:
    """Return the public names by area, in the order of the table above."""
    found: dict[str, list[str]] = {area: [] for area in _AREAS}
    for name, part in public().items():
        while part not in _AREA_OF:
            part = part.rpartition(".")[0]
        found[_AREA_OF[part]].append(name)
    return {area: sorted(names, key=str.lower) for area, names in found.items()}


@cache
def public() -> dict[str, str]:
    """Return the file of every public name: ``solve``, or ``study.tune`` where a room has it."""
    found = _imported(Path(condyn_pin.__file__).with_suffix(".pyi"))
    for stub in sorted(Path(condyn_pin.__file__).parent.glob("*/__init__.pyi")):
        room = stub.parent.name
        for name, part in _imported(stub).items():
            if name not in found:
                found[f"{room}.{name}"] = f"{room}.{part}"
    return found | {
        f"errors.{name}": "errors" for name in condyn_pin.errors.__all__ if name not in found
    }


def _imported(stub: Path) -> dict[str, str]:
    lines = ast.parse(stub.read_text(encoding="utf-8")).body
    imports = [line for line in lines if isinstance(line, ast.ImportFrom) and line.module]
    return {alias.name: str(line.module) for line in imports for alias in line.names}


def write(app: Sphinx) -> None:
    """Write a page for each area; what is unchanged is left alone, so that it is not read again."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    wanted = {f"{_file(area)}.rst": _page(area, names) for area, names in areas().items()}
    pages = "\n".join(f"   {_file(area)}" for area in areas())
    wanted["index.rst"] = (
        f"{_title('API')}{_INTRODUCTION}.. toctree::\n   :maxdepth: 1\n\n{pages}\n"
    )
    for old in folder.glob("*.rst"):
        if old.name not in wanted:
            old.unlink()
    for name, text in wanted.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


_INTRODUCTION = """\
Everything here is ``import condyn_pin as cp`` and ``cp.NAME``, or ``cp.ROOM.NAME``. Shapes are in
round brackets with nq coordinates, nv velocities and m rows; units are SI and in square brackets;
frames and signs are those of :doc:`../conventions`. Arguments after a star go by name.

Some names mean the same everywhere:

``q``, ``v``, ``a``
    configuration (nq,) [rad, m], velocity (nv,) [rad/s, m/s], acceleration (nv,) [rad/s^2, m/s^2];
    ``Q``, ``V`` are many, one row per state; ``q0``, ``v0``, ``Q0``, ``V0`` are those at the start
``tau``
    generalised forces (nv,) [N m, N]
``lam``
    constraint forces (m,), rows in the order of the scene, on the first-named bodies [N, N m]
``M``, ``h``, ``J``, ``gamma``, ``a_ref``
    mass matrix (nv, nv) [kg m^2, kg m, kg], bias forces (nv,) [N m, N], Jacobian of the constraints
    (m, nv) [1, m], their accelerations (m,) where a is zero, and as wanted [m/s^2, rad/s^2]
``da_dq``, ``da_dv``, ``da_dtau``, ``dlam_dq``, ``dlam_dv``, ``dlam_dtau``
    derivatives (nv, nv) and (m, nv) by tangent columns, in units of a, or of lam [N, N m], over
    those of q, v or tau
``t``, ``dt``
    time and step [s]
``scene``, ``workspace``, ``system``, ``terms``
    a `Scene`; a `Workspace` of it; what an integrator sees of it; its M, h, J, gamma at a state
``path``
    of a file, a text or a `pathlib.Path`

"""


def _page(area: str, names: list[str]) -> str:
    return f"{_title(area)}{''.join(_entry(name) for name in names)}"


def _entry(path: str) -> str:
    value = reduce(getattr, path.split("."), condyn_pin)
    room, _, name = f"condyn_pin.{path}".rpartition(".")
    if inspect.isclass(value):
        shown = f".. autoclass:: {name}\n   :members:\n   :inherited-members: {_STOP}"
    elif isinstance(value, dict):
        keys = ", ".join(f"``{key}``" for key in value)
        shown = f".. data:: {name}\n\n   A registry: what there is, by name. {keys}."
    elif callable(value):
        shown = f".. autofunction:: {name}"
    else:
        shown = f".. autodata:: {name}\n   :no-value:"
    return f".. currentmodule:: {room}\n\n{shown}\n\n"


# Whose own methods are not ours to document.
_STOP = "ndarray, Exception, Enum, tuple, dict, Executor"


def _title(text: str) -> str:
    return f"{text}\n{'=' * len(text)}\n\n"


def _file(area: str) -> str:
    return area.lower().replace(" ", "-")


def as_it_stands(
    app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Keep equations and pictures at the start of a docstring, and in its notes, as they stand."""
    shown: list[str] = []
    section = ""
    for paragraph in _paragraphs(lines):
        if len(paragraph) > 1 and paragraph[1].startswith("---"):
            section = paragraph[0].strip()
        if section in ("", "Notes") and _is_picture(paragraph) and not _opened(shown):
            shown += [".. code-block:: none", "", *(f"    {line}" for line in paragraph), ""]
        elif section in ("", "Notes") and paragraph[0].startswith("    "):
            shown += [*paragraph, ""]
        else:
            shown += [*map(_prose, paragraph), ""]
    lines[:] = shown


def _paragraphs(lines: list[str]) -> list[list[str]]:
    """Return the lines between blank ones."""
    text = "\n".join(lines).strip("\n")
    return [part.split("\n") for part in re.split(r"\n\s*\n", text)]


def _is_picture(paragraph: list[str]) -> bool:
    """Whether a paragraph is an equation or a drawing: indented, or a sign and no full stop."""
    if len(paragraph) > 1 and paragraph[1].startswith("---"):
        return False
    if all(line.startswith("    ") for line in paragraph):
        return True
    sentence = paragraph[-1].rstrip().endswith((".", ":", ";"))
    return not sentence and any(" = " in line or " <= " in line for line in paragraph)


def _opened(shown: list[str]) -> bool:
    """Whether the last words end with two colons: a literal block follows."""
    return next((line for line in reversed(shown) if line.strip()), "").rstrip().endswith("::")


def _prose(line: str) -> str:
    """Return a line of a docstring for Sphinx: public names are links, other names are code."""
    parts = re.split(r"(``.*?``|`[^`]+`(?:_)?)", line)
    for index, part in enumerate(parts):
        if index % 2 == 0:
            parts[index] = part.replace("|", r"\|")  # a norm is no substitution
        elif not part.startswith("``"):
            parts[index] = _linked(part.strip("`"))
    return "".join(parts)


def _linked(name: str) -> str:
    """Return a link to what is public, wherever it is; anything else as code."""
    places = {path.rpartition(".")[2]: path for path in public()}
    words = name.removeprefix("condyn_pin.").split(".")
    while words and words[0] not in places:
        words.pop(0)
    if not words or not name.endswith(".".join(words)):
        return f"``{name}``"
    return f"`{name} <condyn_pin.{'.'.join([places[words[0]], *words[1:]])}>`"


def not_ours(app: Any, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what Python writes by itself: the fields of named tuples."""
    return True if str(getattr(thing, "__doc__", "")).startswith("Alias for field") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before they are read."""
    app.connect("builder-inited", write)
    app.connect("autodoc-process-docstring", as_it_stands, priority=100)  # before napoleon
    app.connect("autodoc-skip-member", not_ours)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
