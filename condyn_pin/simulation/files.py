"""Files of trajectories: archives, and csv."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import VERSION_TEXT, pin
from condyn_pin._core.arrays import finite
from condyn_pin._core.files import LARGEST, atomic_write, parse_json, read_npz, write_npz
from condyn_pin.constraints.contacts.ground import Facets, Ground
from condyn_pin.constraints.contacts.kinds import CONTACTS
from condyn_pin.constraints.contacts.shapes import SHAPES, Plane
from condyn_pin.constraints.kinds import kind_named
from condyn_pin.constraints.loop import Loop, axis_of
from condyn_pin.constraints.path import PATHS
from condyn_pin.contact.problem import MODES
from condyn_pin.contact.restitution import RESTITUTION_LAWS
from condyn_pin.contact.solvers.contact_solver import CONTACT_SOLVERS
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import InvalidArgument
from condyn_pin.io.model_words import model_of, model_words
from condyn_pin.model.joints import CoupledMotor
from condyn_pin.model.robot import Robot
from condyn_pin.model.springs import Spring, SpringDamper
from condyn_pin.simulation import integrators
from condyn_pin.simulation.drift import DRIFTS, Drift
from condyn_pin.simulation.events import EventRecord
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.motion_status import Effects, MotionLimits, Run, RunStatus, check_limits
from condyn_pin.simulation.records import (
    ContactRecord,
    Phase,
    Remark,
    candidates_of,
    row_names,
    width,
    written_before,
)
from condyn_pin.simulation.trajectory import Trajectory, columns

# Archives: npz files with a header in JSON, and a robot as words and arrays.
#
# Frozen values are in the header by the name of their class, with their fields.
#
# Nothing in them is executed, and nothing in them is believed: a file may come from a stranger.


Path_ = str | PathLike[str]
Header = dict[str, Any]
Content = dict[str, NDArray[Any]]
Result = TypeVar("Result")

MOTION: Final = "condyn_pin trajectory 2"
MOTIONS: Final = "condyn_pin batch trajectory 2"

# Their models were in a form of Pinocchio's that it cannot check: one damaged digit of it crashes.
_BEFORE: Final = ("condyn_pin trajectory 1", "condyn_pin batch trajectory 1")

# What reads and what writes each.
_READERS: Final = {
    MOTION: "Trajectory.load reads it",
    MOTIONS: "BatchTrajectory.load reads it, and `condyn view --motion 0`",
}
_WRITERS: Final = {
    MOTION: "Trajectory.save and `condyn simulate --save` write one",
    MOTIONS: "BatchTrajectory.save writes one",
}
_TITLES: Final = {MOTION: "a trajectory", MOTIONS: "a batch of motions"}

# The choices of a run that are frozen values, and what they have to be.
CHOICES: Final[dict[str, type]] = {"integrator": Integrator, "drift": Drift, "solver": Solver}

_LISTS = ("loops", "contacts", "springs", "spring_dampers", "coupled_motors")
_WORDS = (
    "name", "actuated", "unused", "unmodelled", "source", "licence", "description", "precision",
    "package_dirs", "lost_rows", "exclusions",
)  # fmt: skip
_POSTURE = "posture "
_MODEL = "model "


def write(
    path: Path_, kind: str, robot: Robot, header: Header, arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a file of a `kind`: a header of words and numbers, and arrays."""
    about = {key: getattr(robot, key) for key in _WORDS}
    about["exclusions"] = sorted(sorted(names) for names in robot.exclusions)
    about |= {key: [encode(c) for c in getattr(robot, key)] for key in _LISTS}
    about["model"], numbers = model_words(robot.model)
    header = {"format": kind, "pinocchio": VERSION_TEXT, "robot": about, **header}
    text = json.dumps(header, default=_python_number)
    if len(text) > LARGEST:
        raise InvalidArgument(
            f"{path}: {len(text) / 1e6:.0f} MB of words, such as events and reasons, are more than "
            "can be read again; save a part of it"
        )
    content = {
        "header": np.array(text),
        **{f"{_MODEL}{name}": array for name, array in numbers.items()},
        **arrays,
        **{f"{_POSTURE}{name}": q for name, q in robot.postures.items()},
    }
    write_npz(path, content)


def read_archive(
    path: Path_,
    kind: str,
    names: Collection[str],
    make: Callable[[Robot, Header, Content], Result],
) -> Result:
    """Result of `make` for the header and the arrays `names` of a file of a `kind`."""
    # InvalidArgument if the file is missing, damaged or of another kind.
    no_file = f"{path}: no file of {_TITLES[kind]}"
    wanted = {"header", *names}
    try:
        content = read_npz(path, lambda n: n in wanted or n.startswith((_MODEL, _POSTURE)))
    except OSError as error:
        raise InvalidArgument(f"{no_file} ({error.strerror})") from error
    except Exception as error:  # zipfile raises whatever a damaged byte makes it
        raise InvalidArgument(
            f"{no_file} ({type(error).__name__} on reading it: {error}); {_WRITERS[kind]}"
        ) from error
    try:
        header = parse_json(str(content["header"]))
        _check_format(header["format"], kind)
        return make(_robot(header["robot"], content), header, content)
    except Exception as error:  # whatever a number or a word makes of what it is not meant for
        raise InvalidArgument(f"{no_file} ({error!r})") from error


def _check_format(found: object, kind: str) -> None:
    if found in _BEFORE:
        raise ValueError(
            f"{found}: written by an older condyn_pin, with a model that cannot be checked; "
            "simulate again, or take its arrays with numpy.load"
        )
    if found != kind:
        raise ValueError(f"{found}: {_READERS.get(str(found), 'nothing here reads it')}")


def _robot(about: dict[str, Any], content: Content) -> Robot:
    numbers = {k.removeprefix(_MODEL): x for k, x in content.items() if k.startswith(_MODEL)}
    postures = {k.removeprefix(_POSTURE): q for k, q in content.items() if k.startswith(_POSTURE)}
    model, lost = model_of(about["model"], numbers)
    # files of before have none of these
    since = ("unmodelled", "package_dirs", "coupled_motors", "lost_rows", "exclusions")
    before = dict.fromkeys(since, ()) | {"precision": tolerances.ROUNDED_GEOMETRY}
    about = before | about
    lists: dict[str, Any] = {key: [decode(c) for c in about[key]] for key in _LISTS}
    words: dict[str, Any] = {key: about[key] for key in _WORDS}
    for key in ("source", "licence", "description"):
        if not isinstance(words[key], str):
            raise TypeError(f"{key} = {words[key]!r}")
    words["unmodelled"] = (*words["unmodelled"], *lost)
    return Robot(model=model, postures=postures, **lists, **words)


def scene_of(robot: Robot, words: dict[str, Any]) -> Scene:
    """Return the scene of a robot with the constraints and contacts of a file."""
    # files of before have no contacts
    lists = (words["constraints"], words.get("contacts", ()))
    return Scene(robot, *([decode(each) for each in those] for those in lists))


def check_times(**times: Any) -> None:
    """Refuse times that are no numbers, or less than nothing, and a step of nothing."""
    for name, time in times.items():
        number = finite(name, time, ())
        if type(time) not in (int, float) or number < 0 or (name == "dt" and not number):
            raise ValueError(f"{name} = {time!r}")


def choice(name: str, coded: dict[str, Any], kind: type) -> Any:
    """Return a frozen value that has to be of a kind."""
    value = decode(coded)
    if not isinstance(value, kind):
        raise TypeError(f"{name} = {value!r}")
    return value


def limits_of(words: dict[str, Any]) -> MotionLimits:
    """Return the limits of a motion in a file; files of before have none."""
    limits = choice("limits", words["limits"], MotionLimits) if "limits" in words else None
    return check_limits(limits)


# What a value in a file may be, by the name of its class.
_KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        *(Effects, EventRecord, MotionLimits, Remark, Spring, SpringDamper, CoupledMotor),
        *(Plane, Ground, Facets),
        *(integrators.INTEGRATORS | DRIFTS | SOLVERS).values(),
    )
}


_CURES: Final = {"along": "a Path can be written, such as Sine or Polynomial"}
_WRITE_A_KIND: Final = (
    "a kind of your own can be written: a dataclass that inherits from FrameRelation or Constraint"
)


def encode(value: Any) -> dict[str, Any]:
    """Return a frozen dataclass as its name and its fields, those in them likewise."""
    assert is_dataclass(value)
    of_it = {field.name: getattr(value, field.name) for field in fields(value)}
    if functions := [key for key, x in of_it.items() if callable(x) and not is_dataclass(x)]:
        raise InvalidArgument(
            f"{getattr(value, 'name', type(value).__name__)}: {functions[0]} is a function, and no "
            f"file can hold one; {_CURES.get(functions[0], _WRITE_A_KIND)}"
        )
    return {"class": type(value).__name__, **{key: _encoded(x) for key, x in of_it.items()}}


def _encoded(value: Any) -> Any:
    """Return a field in words: dataclasses by their fields, also those in a tuple."""
    if isinstance(value, tuple) and value and all(map(is_dataclass, value)):
        return [encode(each) for each in value]
    return encode(value) if is_dataclass(value) else value


def _python_number(value: Any) -> Any:
    """Return a number of numpy as one of Python's: a parameter may be either."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be written to a file")


def decode(coded: dict[str, Any]) -> Any:
    """Return the frozen dataclass of a name and fields; lists become tuples."""
    values = dict(coded)
    name = values.pop("class")
    # those of the user's own have registered since
    kind = (
        _KINDS.get(name)
        or kind_named(name)
        or (CONTACTS | SHAPES | PATHS).get(name)
        or (integrators.INTEGRATORS | DRIFTS | SOLVERS | CONTACT_SOLVERS | RESTITUTION_LAWS).get(
            name.lower()
        )
    )
    if kind is None:
        raise LookupError(f"{name} is unknown: import the module that defines it")
    if kind is Loop:  # files of before have an axis for kinds that have none
        values["axis"] = axis_of(values["kind"], values["axis"])
    return kind(**{k: _decoded_value(x) for k, x in values.items()})


def _decoded_value(value: Any) -> Any:
    if isinstance(value, dict) and "class" in value:
        return decode(value)
    return tuple(map(_decoded_value, value)) if isinstance(value, list) else value


# Files of trajectories: archives, and csv.


_ARRAYS = ("t", "q", "v", "a", "lam", "tau")
_PLAIN = ("duration", "dt", "reason", "wall_time")
_CHOICES = CHOICES | {"effects": Effects}


def save(trajectory: Trajectory, path: Path_) -> None:
    """Write a trajectory; see `Trajectory.save`."""
    arrays = {name: getattr(trajectory, name) for name in _ARRAYS}
    if trajectory.contact:
        arrays["contact"] = trajectory.contact.columns
    write(path, MOTION, trajectory.scene.robot, _header(trajectory), arrays)


def _header(trajectory: Trajectory) -> Header:
    """Header of a trajectory file: phases with constraints and contacts, and the run."""
    run = trajectory.run
    return {
        "phases": [
            {
                "constraints": [encode(c) for c in phase.scene.constraints],
                "contacts": [encode(c) for c in phase.scene.contacts],
                "samples": [phase.samples.start, phase.samples.stop],
                "columns": phase.columns,
            }
            for phase in trajectory.phases
        ],
        "run": {
            **{key: getattr(run, key) for key in _PLAIN},
            **{key: encode(getattr(run, key)) for key in _CHOICES},
            "limits": encode(run.limits),
            "status": run.status.name,
            "happened": [encode(event) for event in run.happened],
            "missed": run.missed,
            "differenced": run.differenced,
            "remarks": [encode(remark) for remark in run.remarks],
        },
    }


def load(path: Path_) -> Trajectory:
    """Return a trajectory from a file; see `Trajectory.load`."""
    return read_archive(path, MOTION, (*_ARRAYS, "contact"), _trajectory)


def _trajectory(robot: Robot, header: Header, content: Content) -> Trajectory:
    phases = tuple(
        Phase(
            scene_of(robot, phase),
            slice(*phase["samples"]),
            tuple(phase["columns"]),
        )
        for phase in header["phases"]
    )
    _check_arrays(content, robot, phases)
    made = _run(header["run"])
    _check_run(made, len(content["t"]))
    contact = None
    if "contact" in content:
        names = dict.fromkeys(n for phase in phases for n in candidates_of(phase.scene).names)
        is_driven = any(phase.scene.is_driven for phase in phases)
        kept = written_before(content["contact"], len(names))
        shape = (len(content["t"]), width(len(names), is_driven=is_driven))
        contact = ContactRecord(tuple(names), finite("contact", kept, shape))
    arrays = {name: content[name] for name in _ARRAYS}
    return Trajectory(phases=phases, run=made, contact=contact, **arrays)


def _run(run: dict[str, Any]) -> Run:
    return Run(
        **{key: run[key] for key in _PLAIN},
        **{key: choice(key, run[key], kind) for key, kind in _CHOICES.items()},
        limits=limits_of(run),
        status=RunStatus[run["status"]],
        happened=tuple(decode(event) for event in run["happened"]),
        missed=tuple(run.get("missed", ())),  # files of before have none
        differenced=int(run.get("differenced", 0)),
        remarks=tuple(decode(remark) for remark in run.get("remarks", ())),
    )


def _check_arrays(content: Content, robot: Robot, phases: tuple[Phase, ...]) -> None:
    """Refuse arrays that do not fit each other, and numbers that are none."""
    k, nv = _count(phases), robot.nv
    m = max((column + 1 for phase in phases for column in phase.columns), default=0)
    shapes = {"t": (k,), "q": (k, robot.nq), "lam": (k, m)} | dict.fromkeys(
        ("v", "a", "tau"), (k, nv)
    )
    for name, shape in shapes.items():
        if finite(name, content[name], shape).dtype != content[name].dtype:
            raise ValueError(f"{name} is of {content[name].dtype}: float64 is needed")
    times = [content["t"][phase.samples] for phase in phases]
    if any((np.diff(t) <= 0).any() for t in times) or (np.diff(content["t"]) < 0).any():
        raise ValueError("t goes back, or stands still")
    for i, q in enumerate(content["q"]):
        if not pin.isNormalized(robot.model, q, tolerances.QUATERNION):
            raise ValueError(f"q[{i}] has a quaternion that is not normalised")


def _count(phases: tuple[Phase, ...]) -> int:
    """Number of samples in all phases; ValueError if samples or columns do not fit."""
    count = 0
    for phase in phases:
        start, stop = phase.samples.start, phase.samples.stop
        if type(start) is not int or type(stop) is not int or start != count or stop <= start:
            raise ValueError(f"samples {start} to {stop} of a phase do not follow {count}")
        columns, rows = phase.columns, len(row_names(phase.scene))
        if not all(type(column) is int and column >= 0 for column in columns) or not (
            len(columns) == len(set(columns)) == rows
        ):
            raise ValueError(f"columns {columns}: {rows} different ones are needed")
        count = stop
    return count


def _check_run(run: Run, count: int) -> None:
    """Refuse what are no words, times and events of a run."""
    if not isinstance(run.reason, str):
        raise TypeError(f"reason = {run.reason!r}")
    check_times(duration=run.duration, dt=run.dt, wall_time=run.wall_time)
    if not all(isinstance(why, str) for why in run.missed):
        raise TypeError(f"missed = {run.missed!r}")
    for remark in run.remarks:
        if not isinstance(remark, Remark) or not isinstance(remark.text, str):
            raise TypeError(f"remarks = {run.remarks!r}")
        check_times(t=remark.t, steps=remark.steps)
    for event in run.happened:
        if not isinstance(event, EventRecord) or not _is_valid_event(event, count):
            raise ValueError(f"event {event!r} of {count} samples")


def _is_valid_event(event: EventRecord, count: int) -> bool:
    """True if an event has valid names, and its sample is one of `count`."""
    struck = event.impulses
    words = (event.name, *event.added, *event.dropped, *(name for name, *_ in struck))
    words += tuple(name for name, _, _ in event.modes)
    if not all(mode in MODES for _, *both in event.modes for mode in both):
        raise ValueError(f"modes = {event.modes!r}")
    numbers = [x for _, *impulse in struck for x in impulse]
    finite("impulses", numbers, len(numbers))
    finite("t", event.t, ())
    finite("energy_lost", event.energy_lost, ())
    finite("driven", event.driven, ())
    known = type(event.sample) is int and event.sample in range(count)
    return known and all(isinstance(word, str) for word in words)


def to_csv(trajectory: Trajectory, path: Path_) -> None:
    """Write a trajectory as a table; see `Trajectory.to_csv`."""
    table = columns(trajectory)
    samples, header = np.column_stack(list(table.values())), ",".join(table)
    with atomic_write(path) as new:
        np.savetxt(new, samples, fmt="%.17g", delimiter=",", header=header, comments="")
