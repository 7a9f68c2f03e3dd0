"""Files of trajectories: npz with a header in JSON, and csv."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._pin import VERSION_TEXT, pin
from condyn_pin.arrays import finite
from condyn_pin.constraints import Coupling, Loop
from condyn_pin.contacts import LineContact, PlanarContact, PointContact, SurfaceContact
from condyn_pin.drift import DRIFTS
from condyn_pin.errors import InvalidArgument
from condyn_pin.nonholonomic import Knife, RollingBall, RollingWheel
from condyn_pin.robot import Robot
from condyn_pin.scene import Scene
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.events import Happened
from condyn_pin.simulation.integrators import INTEGRATORS
from condyn_pin.simulation.outcome import Run, RunStatus
from condyn_pin.simulation.recorder import Phase
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.solvers import SOLVERS
from condyn_pin.spring import Spring

Path_ = str | PathLike[str]

_FORMAT = "condyn_pin trajectory 1"
_LISTS = ("loops", "contacts", "springs")
_WORDS = ("name", "actuated", "unused", "source", "licence", "description")
_ARRAYS = ("t", "q", "v", "a", "lam", "tau")

# What a value in a file may be, by the name of its class.
_KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        *(PointContact, SurfaceContact, LineContact, PlanarContact, Loop, Coupling),
        *(Knife, RollingBall, RollingWheel),
        *(Effects, Happened, Spring),
        *(INTEGRATORS | DRIFTS | SOLVERS).values(),
    )
}


def save(trajectory: Trajectory, path: Path_) -> None:
    """Write a trajectory; see `Trajectory.save`."""
    robot, run = trajectory.scene.robot, trajectory.run
    header = {
        "format": _FORMAT,
        "pinocchio": VERSION_TEXT,
        "robot": {
            **{key: getattr(robot, key) for key in _WORDS},
            **{key: [_encode(c) for c in getattr(robot, key)] for key in _LISTS},
        },
        "phases": [
            {
                "constraints": [_encode(c) for c in phase.scene.constraints],
                "samples": [phase.samples.start, phase.samples.stop],
                "columns": phase.columns,
            }
            for phase in trajectory.phases
        ],
        "run": {
            "duration": run.duration,
            "dt": run.dt,
            "integrator": _encode(run.integrator),
            "drift": _encode(run.drift),
            "solver": _encode(run.solver),
            "effects": _encode(run.effects),
            "status": run.status.name,
            "reason": run.reason,
            "happened": [_encode(event) for event in run.happened],
            "missed": run.missed,
            "wall_time": run.wall_time,
        },
    }
    with Path(path).open("wb") as file:  # a name without .npz stays as it is
        content = {
            "header": np.array(json.dumps(header)),
            "model": np.array(robot.model.saveToString()),
            **{name: getattr(trajectory, name) for name in _ARRAYS},
            **{f"posture {name}": q for name, q in robot.postures.items()},
        }
        np.savez_compressed(file, allow_pickle=False, **content)


def load(path: Path_) -> Trajectory:
    """Return a trajectory from a file; see `Trajectory.load`."""
    try:
        # numpy leaves a file open that is no archive
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
    except OSError as error:
        raise InvalidArgument(f"{path}: no file of a trajectory ({error.strerror})") from error
    except Exception as error:  # numpy and zipfile raise whatever a damaged byte makes them
        raise InvalidArgument(
            f"{path}: no file of a trajectory ({type(error).__name__} on reading it); "
            "Trajectory.save and `condyn simulate --save` write one"
        ) from error
    try:
        header = json.loads(str(content["header"]))
        written_by = header["pinocchio"]
        if header["format"] != _FORMAT:
            raise KeyError(header["format"])
        if _series(written_by) == _series(VERSION_TEXT):
            return _trajectory(header, content)
    except (LookupError, AttributeError, TypeError, ValueError, RuntimeError) as error:
        raise InvalidArgument(f"{path}: no file of a trajectory ({error!r})") from error
    # not tried: Pinocchio 4.1 crashes on a model that 3.9 wrote
    raise InvalidArgument(
        f"{path}: its model was written by Pinocchio {written_by}, and {VERSION_TEXT} is "
        "installed; use the same one, or to_csv"
    )


def _series(version: str) -> list[str]:
    """Return major and minor number of a version."""
    return version.split(".")[:2]


def _trajectory(header: dict[str, Any], content: dict[str, Any]) -> Trajectory:
    robot = _robot(header, content)
    phases = tuple(
        Phase(
            Scene(robot, [_decode(c) for c in phase["constraints"]]),
            slice(*phase["samples"]),
            tuple(phase["columns"]),
        )
        for phase in header["phases"]
    )
    _check_arrays(content, robot, phases)
    run = header["run"]
    made = Run(
        duration=run["duration"],
        dt=run["dt"],
        integrator=_decode(run["integrator"]),
        drift=_decode(run["drift"]),
        solver=_decode(run["solver"]),
        effects=_decode(run["effects"]),
        status=RunStatus[run["status"]],
        reason=run["reason"],
        happened=tuple(_decode(event) for event in run["happened"]),
        missed=tuple(run.get("missed", ())),  # files of before have none
        wall_time=run["wall_time"],
    )
    return Trajectory(phases=phases, run=made, **{name: content[name] for name in _ARRAYS})


def _check_arrays(content: dict[str, Any], robot: Robot, phases: tuple[Phase, ...]) -> None:
    """Refuse arrays that do not fit each other, and numbers that are none."""
    k, nv = phases[-1].samples.stop, robot.nv
    m = max((column + 1 for phase in phases for column in phase.columns), default=0)
    shapes = {"t": (k,), "q": (k, robot.nq), "lam": (k, m)} | dict.fromkeys(
        ("v", "a", "tau"), (k, nv)
    )
    for name, shape in shapes.items():
        finite(name, content[name], shape)


def _robot(header: dict[str, Any], content: dict[str, Any]) -> Robot:
    model = pin.Model()
    model.loadFromString(str(content["model"]))
    about = header["robot"]
    lists: dict[str, Any] = {key: [_decode(c) for c in about[key]] for key in _LISTS}
    words: dict[str, Any] = {key: about[key] for key in _WORDS}
    begin = "posture "
    postures = {k.removeprefix(begin): q for k, q in content.items() if k.startswith(begin)}
    return Robot(model=model, postures=postures, **lists, **words)


def _encode(value: Any) -> dict[str, Any]:
    """Return a frozen dataclass as its name and its fields."""
    assert is_dataclass(value)
    return {"class": type(value).__name__, **asdict(value)}  # type: ignore[arg-type]


def _decode(coded: dict[str, Any]) -> Any:
    """Return the frozen dataclass of a name and fields; lists become tuples."""
    values = dict(coded)
    kind = _KINDS[values.pop("class")]
    return kind(**{k: tuple(x) if isinstance(x, list) else x for k, x in values.items()})


def to_csv(trajectory: Trajectory, path: Path_) -> None:
    """Write a trajectory as a table; see `Trajectory.to_csv`."""
    energy, robot = trajectory.energy, trajectory.scene.robot
    names = ["t [s]", *(f"q{i}" for i in range(robot.nq))]
    names += [f"{x}{i}" for x in ("v", "a", "tau") for i in range(robot.nv)]
    names += [f"lam {name}" for name in trajectory.row_names]
    names += ["violation", "slip", *(f"{f.name} [J]" for f in fields(energy))]
    table = np.column_stack(
        [
            *(trajectory.t, trajectory.q, trajectory.v, trajectory.a, trajectory.tau),
            *(trajectory.lam, trajectory.violation, trajectory.slip),
            *(getattr(energy, f.name) for f in fields(energy)),
        ]
    )
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(names), comments="")
