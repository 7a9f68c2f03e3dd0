"""Sets of states for studies: closed, consistent, and reproducible."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from math import inf
from typing import Final, cast

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count, check_type, is_whole
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.timing import State
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.control.inverse import gravity_compensation
from condyn_pin.dynamics.at_state import moves_back
from condyn_pin.dynamics.scene import Scene, motor_torque, standard_scenes
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.io.load import load_robot
from condyn_pin.mechanism.assembling import place_on_ground
from condyn_pin.model.robot import Robot


class States(ABC):
    """A way to get states (q, v, tau) of a scene; a frozen value."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the set in tables."""

    @abstractmethod
    def of(self, scene: Scene) -> tuple[State, ...]:
        """Return the states of a scene."""

    def overlaps(self, name: str) -> bool:
        """True if the set of this name shares states with this one."""
        return name == self.name

    def judged_at(self, scene: Scene, state: State) -> State:
        """State at which the truth about a state of this set is taken: the same."""
        return state

    @property
    def exact(self) -> bool:
        """True if the states satisfy the constraints."""
        return True


def _gravity_compensated(scene: Scene, q: Array, v: Array, tau: Array) -> State:
    has_motors = bool(scene.robot.motor_joints)
    return q, 0 * v, gravity_compensation(scene.bilateral, q).tau if has_motors else 0 * tau


# What is done with a random closed q, v and motor torque.
LOADS: Final[Mapping[str, Callable[[Scene, Array, Array, Array], State]]] = {
    "random": lambda scene, q, v, tau: (q, v, tau),
    "zero": lambda scene, q, v, tau: (q, v, 0 * tau),
    "compensated": _gravity_compensated,
    "rest": lambda scene, q, v, tau: (q, 0 * v, 0 * tau),
}


@dataclass(frozen=True)
class SampledStates(States):
    """Random states of `Scene.sample`, under one load after the other.

    A method is not equally accurate under all of them: errors are relative to the larger of |a| and
    gravity, and large random torques hide some that show without any. With contacts that may open
    the robot stands on the lowest of them: in motion it hits, slides and lifts off.

    Parameters
    ----------
    count : int
        Number of states.
    seed : int
        The same seed gives the same states.
    spread, speed : float
        As in `Scene.sample`.
    loads : sequence of str
        In turn: in motion under ``random`` torques in the motors, and under ``zero`` torques; at
        rest under torques that are ``compensated`` for gravity, as far as the motors can, and at
        ``rest`` without any.

    Raises
    ------
    InvalidArgument
        If the count is not positive, the seed is negative, or there is no load.
    UnknownName
        If there is no such load.
    """

    count: int = 20
    seed: int = 0
    spread: float = 0.2  # [rad, m]
    speed: float = 1.0  # [rad/s, m/s]
    loads: Sequence[str] = tuple(LOADS)

    def __post_init__(self) -> None:
        check_count("count", self.count)
        loads = (self.loads,) if isinstance(self.loads, str) else tuple(self.loads)
        if not loads:
            raise InvalidArgument(f"loads = {self.loads!r}: some of {', '.join(LOADS)} are needed")
        for load in loads:
            if load not in LOADS:
                raise unknown_name("load", str(load), LOADS)
        object.__setattr__(self, "loads", loads)
        check_count("seed", self.seed, least=0)

    @property
    def name(self) -> str:
        """Count, loads and seed, and spread and speed if they differ from their defaults."""
        usual = (self.spread, self.speed) == (0.2, 1.0)
        other = "" if usual else f", spread {self.spread:g}, speed {self.speed:g}"
        loads = "all loads" if self.loads == tuple(LOADS) else ", ".join(self.loads)
        return f"{self.count} sampled under {loads}, seed {self.seed}{other}"

    def overlaps(self, name: str) -> bool:
        """True if the set of this name has the same draws: the larger one begins as the other.

        Other loads are put on the same q and v.
        """
        return _sampling_parameters(name) == _sampling_parameters(self.name)

    def of(self, scene: Scene) -> tuple[State, ...]:
        """Return the states of a scene."""
        rng = np.random.default_rng(self.seed)
        made = []
        for _, load in zip(range(self.count), cycle(self.loads), strict=False):
            q, v = scene.sample(rng, spread=self.spread, speed=self.speed)
            q = place_on_ground(scene, q) if scene.contacts else q
            made.append(LOADS[load](scene, q, v, motor_torque(scene.robot, rng)))
        return tuple(made)


@dataclass(frozen=True)
class NominalStates(States):
    """The nominal configuration: at rest, and moving along the constraints under torques."""

    @property
    def name(self) -> str:
        """``nominal``."""
        return "nominal"

    def of(self, scene: Scene) -> tuple[State, ...]:
        """Return the states of a scene."""
        return tuple((s.q, s.v, s.tau) for s in scene.nominal.states)


@dataclass(frozen=True)
class PostureStates(States):
    """The postures of the robot, closed, at rest and without torques.

    Parameters
    ----------
    postures : sequence of str, optional
        All of them by default.

    Raises
    ------
    InvalidArgument
        If `postures` is a text instead of a list.
    """

    postures: Sequence[str] = ()

    def __post_init__(self) -> None:
        if isinstance(self.postures, str):
            raise InvalidArgument(f"postures = {self.postures!r}: a list is needed")
        object.__setattr__(self, "postures", tuple(self.postures))

    @property
    def name(self) -> str:
        """The names of the postures."""
        return f"postures: {', '.join(self.postures) or 'all'}"

    def of(self, scene: Scene) -> tuple[State, ...]:
        """Return the states of a scene."""
        names = self.postures or tuple(scene.robot.postures) or (None,)
        return tuple((*scene.state(name), np.zeros(scene.robot.nv)) for name in names)


@dataclass(frozen=True, eq=False)
class GivenStates(States):
    """States that you provide: loops closed, and velocities along the constraints.

    Parameters
    ----------
    label : str
        What tables call the set.
    states : sequence of (q, v, tau)
    """

    label: str
    states: Sequence[State]

    @property
    def name(self) -> str:
        """The label."""
        return self.label

    def of(self, scene: Scene) -> tuple[State, ...]:
        """Return the states.

        Raises
        ------
        InvalidArgument
            If there is none, or one has a wrong size.
        NotAssembled
            If a loop is open, or a velocity not along the constraints: off the constraints correct
            methods differ, and there is no error to speak of.
        """
        if not self.states:
            raise InvalidArgument(f"states {self.label!r}: at least one is needed")
        for state in self.states:
            if not isinstance(state, Sequence) or len(state) != 3:
                raise InvalidArgument(f"states {self.label!r}: {state!r} is no (q, v, tau)")
            scene.check(*state[:2]).raise_if_open()
        nv = scene.robot.nv
        return tuple(
            (np.array(q, dtype=np.float64), np.array(v, dtype=np.float64), finite("tau", tau, nv))
            for q, v, tau in self.states
        )


@dataclass(frozen=True)
class NoisyStates(States):
    """States of another set as sensors measure them, each judged by the closed machine beside it.

    Parameters
    ----------
    of_set : States
    noise : float or (float, float)
        Standard deviation of q [rad, m] and of v [rad/s, m/s]; one number is both.

    Raises
    ------
    InvalidArgument
        If the noise is negative or not finite.
    """

    of_set: States
    noise: float | tuple[float, float]

    def __post_init__(self) -> None:
        sizes = np.broadcast_to(np.asarray(self.noise, dtype=float), 2).tolist()
        for size in sizes:
            if not 0.0 <= size < inf:
                raise InvalidArgument(f"noise = {self.noise!r}: finite sizes >= 0 are needed")
        object.__setattr__(self, "noise", tuple(sizes))

    @property
    def _sizes(self) -> tuple[float, float]:
        return cast("tuple[float, float]", self.noise)

    @property
    def name(self) -> str:
        """That of the other set, and the noise."""
        q, v = self._sizes
        return f"{self.of_set.name}, noise {q:g}" + ("" if v == q else f" and {v:g}")

    @property
    def exact(self) -> bool:
        """True if there is no noise."""
        return not any(self._sizes)

    def of(self, scene: Scene) -> tuple[State, ...]:
        """Return the states of a scene.

        Raises
        ------
        InvalidArgument
            If the scene has contacts that may open: they have no closed state.
        """
        if scene.contacts:
            raise InvalidArgument("noise: contacts that may open have no closed state beside one")
        rng, (of_q, of_v), model = np.random.default_rng(0), self._sizes, scene.robot.model
        made = []
        for q, v, tau in self.of_set.of(scene):
            moved = pin.integrate(model, q, of_q * rng.normal(size=model.nv))
            made.append((moved, v + of_v * rng.normal(size=model.nv), tau))
        return tuple(made)

    def judged_at(self, scene: Scene, state: State) -> State:
        """Closed machine beside a state."""
        q, v, tau = state
        dq, dv = moves_back(scene, q, v)
        return pin.integrate(scene.robot.model, q, -dq), v - dv, tau


def _sampling_parameters(name: str) -> str:
    """Seed, spread and speed in the name of a sampled set; of any other set, the name."""
    found = re.fullmatch(r"\d+ sampled.*?(, seed .*)", name)
    return found[1] if found else name


def as_states(states: States | int) -> States:
    """Return a set of states; a number is that many sampled ones."""
    if isinstance(states, States):
        return states
    if not is_whole(states):
        raise InvalidArgument(
            f"states = {states!r}: a number of them is needed, or a set such as "
            "SampledStates(20, seed=0) or NominalStates()"
        )
    return SampledStates(int(states))


# Scenes of a study: their labels, and other ways to model the same machine.


Scenes = Scene | str | Mapping[str, Scene] | Iterable[Scene | str]


def labelled(
    scenes: Scenes, scenes_of: Callable[[Robot], Mapping[str, Scene]] = standard_scenes
) -> dict[str, Scene]:
    """Return scenes by label; the name of a robot stands for those that `scenes_of` makes."""
    if isinstance(scenes, Mapping):
        pairs = list(scenes.items())
    else:
        check_type("scenes", scenes, Scene | Iterable, "a Scene, or the name of a robot, is needed")
        several = [scenes] if isinstance(scenes, Scene | str) else list(scenes)
        pairs = [pair for one in several for pair in _pairs(one, scenes_of)]
    found = dict(pairs)
    if not pairs or not all(isinstance(scene, Scene) for scene in found.values()):
        raise InvalidArgument(
            f"scenes = {scenes!r}: scenes, or names of robots, and at least one are needed"
        )
    if len(found) < len(pairs):
        twice = Counter(label for label, _ in pairs).most_common(1)[0][0]
        raise InvalidArgument(
            f"scenes: two of them are called {twice!r}; a dict {{label: scene}} gives them names"
        )
    return found


def modellings(scene: Scene) -> dict[str, Scene]:
    """Return a scene as it is, and the same machine with other constraints that hold the same.

    A surface is its four corners, 12 rows for 6; an edge its two ends, 6 rows for 5; a hinge two
    points of its axis, 6 rows for 5; and a weld three points, 9 rows for 6. All are exact, the
    points at the price of redundant rows.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict of str to Scene
        "as it is", and one for each of the four that the scene has.
    """
    made = {"as it is": scene}
    for label in sorted({constraint.by_points_called for constraint in scene.constraints} - {""}):
        robot, constraints = scene.robot, list[Constraint]()
        for constraint in scene.constraints:
            robot, points = (
                constraint.by_points(robot)
                if constraint.by_points_called == label
                else (robot, (constraint,))
            )
            constraints += points
        if tuple(constraints) != scene.constraints:
            made[label] = Scene(robot, constraints, scene.contacts)
    return made


def _pairs(
    one: Scene | str, scenes_of: Callable[[Robot], Mapping[str, Scene]]
) -> list[tuple[str, Scene]]:
    if isinstance(one, str):
        return list(scenes_of(load_robot(one)).items())
    if not isinstance(one, Scene):
        raise InvalidArgument(f"scenes: {one!r} is neither a scene nor the name of a robot")
    return [(f"{one.robot.name}, {one.rows} rows", one)]
