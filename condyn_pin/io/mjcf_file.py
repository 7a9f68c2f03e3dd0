"""An MJCF file: opened with its includes, limited in size, and compiled by MuJoCo.

A word of it can ask for more than any machine has. MuJoCo's parser makes all copies before it looks
at any, in a time that grows with the square of

    copies = sum of (product of <replicate count> around an element) - 1
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from os import PathLike
from pathlib import Path
from typing import Any, Final
from warnings import catch_warnings
from xml.etree.ElementTree import Element

from condyn_pin.errors import InvalidModel, MissingExtra
from condyn_pin.io.xml import check_counts, label, open_xml, place, quoted_text

_PARTS: Final = 10_000  # a robot has hundreds; MuJoCo makes so many in seconds
_ENTRIES: Final = 10_000_000  # of one table: a picture of 3000 x 3000

# Numbers that multiply to the parts, or to the entries of a table, of an element.
_MULTIPLIES: Final = {"replicate": "count"}
_MAKES: Final = {"flexcomp": "count", "composite": "count"}
_TABLES: Final = {
    "hfield": ("nrow", "ncol"),
    "texture": ("width", "height"),
    "numeric": ("size",),
    "size": ("nkey", "nuserdata"),
    "user": ("dim",),
    "mesh": ("params",),  # of a plate or a wedge the first two are counts, and angles follow
}
_HISTORY: Final = ("nsample", "actdim")
_DEEPEST: Final = 16  # models that attach models


def compiled(path: str | PathLike[str], tag: str = "") -> tuple[Any, tuple[str, ...]]:
    """Return the mujoco.MjModel of a file, and its missing meshes, a sentence each."""
    # A missing mesh is left out if no inertia depends on it. MuJoCo writes no file of warnings.
    path = Path(path)
    if path.suffix == ".xml":
        root = _with_includes(path, tag)
        check_counts(sum(1 for _ in root.iter("body")), 0)
        _parts(root, path.parent, 1)
    mujoco = require_mujoco("MuJoCo's own compiler reads an MJCF")
    told: list[str] = []
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(told.append)  # by itself it writes a file MUJOCO_LOG.TXT
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        lost = tuple(_without_lost_meshes(mujoco, spec, path.parent))
        with catch_warnings(action="ignore"):  # about M, which is looked at here
            mj = spec.compile()
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        raise InvalidModel(f"MuJoCo refuses: {' '.join(str(error).split())}") from error
    finally:
        mujoco.set_mju_user_warning(handler)
    if any("NaN" in warning for warning in told):
        raise InvalidModel("a number in it is NaN; finite numbers are needed")
    return mj, lost


def _without_lost_meshes(mujoco: Any, spec: Any, folder: Path) -> Iterator[str]:
    """Delete the geoms of missing mesh files that give no inertia; yield a sentence for each."""
    if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return
    for mesh in list(spec.meshes):
        geoms = [geom for geom in spec.geoms if geom.meshname == mesh.name]
        there = not mesh.file or folder.joinpath(spec.meshdir, mesh.file).is_file()
        weighs = any(not (g.parent.explicitinertial or g.parent.name == "world") for g in geoms)
        if there or weighs:  # what is not there is named by MuJoCo then
            continue
        for geom in geoms:
            yield f"body {geom.parent.name!r} is not drawn whole: no file {mesh.file!r}"
            spec.delete(geom)
        spec.delete(mesh)


def require_mujoco(reason: str) -> Any:
    """Return the module of MuJoCo, or raise MissingExtra with the reason why it is needed."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtra(f"{reason}: python -m pip install 'condyn_pin[mjcf]'") from error
    return mujoco


def disabled(mj: Any, *what: str) -> bool:
    """True if one of these features is off by the flags of a mujoco.MjModel."""
    flags = require_mujoco("flags of an MJCF").mjtDisableBit
    return any(mj.opt.disableflags & int(getattr(flags, f"mjDSBL_{each}")) for each in what)


def names_of(mj: Any, kind: str) -> list[str]:
    """Return the names of all elements of a kind, ``KINDk`` for those without; no body or joint."""
    mujoco = require_mujoco("names of an MJCF")
    numbers = range(len(getattr(mj, f"name_{kind}adr")))
    of_kind = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
    return [mujoco.mj_id2name(mj, of_kind, k) or f"{kind}{k}" for k in numbers]


def body_names(mj: Any) -> list[str]:
    """Return the names of the bodies of a mujoco.MjModel, ``bodyK`` for those without."""
    return [mj.body(k).name or f"body{k}" for k in range(mj.nbody)]


def joint_names(mj: Any) -> list[str]:
    """Return the names of its joints, ``BODY_jointK`` for those without."""
    bodies = body_names(mj)
    names = []
    for k in range(mj.njnt):
        body = int(mj.jnt_bodyid[k])
        number = k - int(mj.body_jntadr[body])
        names.append(mj.joint(k).name or f"{bodies[body]}_joint{number or ''}")
    return names


def _with_includes(path: Path, tag: str = "") -> Element:
    """Root of a file, every <include> replaced by the content of the included file."""
    # Names are relative to the first file, and none is included twice, as MuJoCo has it.
    root = open_xml(path, tag)
    seen: set[Path] = set()
    waiting = [root]
    while waiting:
        parent = waiting.pop()
        while (found := parent.find("include")) is not None:
            file = (path.parent / found.get("file", "")).resolve()
            if file in seen:
                raise InvalidModel(f"<include>: {file} is included twice")
            seen.add(file)
            at = list(parent).index(found)
            with place(file):
                parent[at : at + 1] = list(open_xml(file))
        waiting.extend(parent)
    return root


def _parts(root: Element, folder: Path, depth: int) -> float:
    """Number of copies made by MuJoCo's parser, those in attached files among them."""
    if depth > _DEEPEST:
        raise InvalidModel("<attach>: models attach each other without an end")
    attached = {
        model.get("name", model.get("file")): _parts(_with_includes(path), path.parent, depth + 1)
        for model in root.iter("model")
        if model.get("file")
        for path in [folder / model.get("file", "")]
        if path.suffix == ".xml" and path.is_file()  # MuJoCo reads, or misses, others
    }
    total, waiting = 0.0, [(root, 1.0)]
    while waiting:
        element, times = waiting.pop()
        _check_tables(element)
        made = prod(_counts(element, _MAKES.get(element.tag, "")))
        made += attached.get(element.get("model"), 1) if element.tag == "attach" else 0
        total += times * made - 1
        times *= prod(_counts(element, _MULTIPLIES.get(element.tag, "")))
        if total > _PARTS or times > _PARTS:
            raise InvalidModel(
                f"{label(element)} makes more than {_PARTS} parts, and no robot has so many"
            )
        waiting.extend((child, times) for child in element)
    return total


def _check_tables(element: Element) -> None:
    names = (*_TABLES.get(element.tag, ()), *(n for n in _HISTORY if n in element.attrib))
    names += tuple(n for n in element.attrib if n.startswith("nuser_"))
    numbers = {name: prod(_counts(element, name)[:2]) for name in names}
    if prod(numbers.values()) > _ENTRIES:
        said = ", ".join(f"{name} = {quoted_text(element.get(name, ''))}" for name in numbers)
        raise InvalidModel(f"{label(element)}: {said}: more than {_ENTRIES} entries")


def _counts(element: Element, name: str) -> list[float]:
    """Counts in an attribute, each at least 1; other text is for MuJoCo to refuse."""
    try:
        return [max(float(word), 1.0) for word in element.get(name, "1").split()]
    except ValueError:
        return [1.0]
