"""Margin and ConeRows: what cones say of the forces of an answer, and of those to be found.

Contacts stay bilateral: a cone is judged here, and enforced nowhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array
from condyn_pin.at_state import equations_of
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.force import presses, upward
from condyn_pin.scene import Scene, check_scene
from condyn_pin.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from condyn_pin.batch.solution import BatchSolution
    from condyn_pin.batch.trajectory import BatchTrajectory
    from condyn_pin.cones import Cone
    from condyn_pin.impacts import Impact
    from condyn_pin.motors.inverse import InverseDynamics
    from condyn_pin.solution import Solution

Answer: TypeAlias = (
    "Solution | BatchSolution | Trajectory | BatchTrajectory | InverseDynamics | Impact"
)
Cones: TypeAlias = "Cone | Mapping[str, Cone]"

# What a contact does where its force leaves the cone. The later ones are often only consequences of
# the first: what pulls also slips, by numbers.
FAULTS: Final = ("pulls", "slips", "tips", "twists")


@dataclass(frozen=True, eq=False, repr=False)
class Margin:
    """How far forces are from leaving a cone; what is below zero has left it.

    Each has a number for each of k forces, and a single number for a single force. Where a contact
    is away all are infinite, and where there is no answer NaN. Impulses have [N s] in place of [N].

    Attributes
    ----------
    pulls : (k,) array
        Normal force [N].
    slips : (k,) array
        Tangential force that is left before it slips [N].
    tips : (k,) array
        Normal force on the edge that lifts first [N]; infinite for a point.
    twists : (k,) array
        Yaw torque that is left before it turns about the normal, over half_length + half_width, as
        a tangential force [N]; infinite for a point.
    noise : (k,) array
        The size of a force that counts as none [N].
    """

    pulls: Array
    slips: Array
    tips: Array
    twists: Array
    noise: Array  # [N]

    @property
    def least(self) -> Array:
        """The smallest of the four [N]; a floor can give the force if it is not negative."""
        return np.asarray(np.minimum.reduce(self._four))[()]

    @property
    def fault(self) -> str | Array:
        """Which of the four is violated, the first of them if several are; empty if none is.

        An array of text for many forces. "unknown" where there is no answer.
        """
        left = [four < -self.noise for four in self._four]
        found = np.select([np.isnan(self.least), *left], ["unknown", *FAULTS], "")
        return found if found.ndim else str(found)

    @property
    def _four(self) -> tuple[Array, ...]:
        return self.pulls, self.slips, self.tips, self.twists

    def __repr__(self) -> str:
        faults, least = np.ravel(self.fault), np.ravel(self.least)
        if least.size == 1:
            return f"Margin({least[0]:.4g} N{f': {faults[0]}' if faults[0] else ''})"
        counts = ((int((faults == each).sum()), each) for each in (*FAULTS, "unknown"))
        said = ", ".join(f"{n} {fault}" for n, fault in counts if n) or "no faults"
        worst = float(np.fmin.reduce(least, initial=np.inf))
        return f"Margin({least.size} forces, {worst:.4g} N at least: {said})"


@dataclass(frozen=True, eq=False)
class ConeRows:
    """Linear inequalities of forces, A f <= b, as a quadratic program takes them.

    Attributes
    ----------
    A : (r, m) array
        For the forces of a scene, columns in the order and sign of its `lam` [1, 1/m].
    names : tuple of str
        Of the rows: the contact, what it does where the row is violated, and on which side.
    """

    A: Array
    names: tuple[str, ...]

    @property
    def b(self) -> Array:
        """Zeros (r,) [N]: these are cones."""
        return np.zeros(len(self.A))


def margins(answer: Answer, cones: Cones) -> dict[str, Margin]:
    """Judge the contact forces of an answer, or of a motion, by friction cones.

    Parameters
    ----------
    answer : Solution, BatchSolution, Trajectory, BatchTrajectory, InverseDynamics or Impact
        What has contact forces.
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name, and then only these are
        judged.

    Returns
    -------
    dict of str to Margin
        By contact [N]; of a batch or a motion with a number for each state, (N, k) of both.

    Raises
    ------
    InvalidArgument
        If a cone is not for that kind of contact, a size or a normal is not known, or there is no
        contact to judge.
    UnknownName
        If no constraint has that name.

    Notes
    -----
    Costs half a millisecond, and for many states tens of microseconds each.
    """
    if isinstance(answer, Trajectory):
        return _margins_of_motion(answer, cones)
    at: Any = getattr(answer, "samples", answer)  # of a batch of motions
    if not (hasattr(answer, "scene") and hasattr(at, "q") and hasattr(at, "lam")):
        raise InvalidArgument(
            f"answer = {type(answer).__name__}: it has no contact forces; a batch of motions keeps "
            "them with record=..."
        )
    _check(cones, [answer.scene])
    return _margins(answer.scene, at.q, at.lam, _noise(at.lam, axis=-1), cones)


def cone_rows(scene: Scene, q: ArrayLike, cones: Cones) -> ConeRows:
    """Return the friction cones of a scene as rows for a program of yours: A lam <= b.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration. Where points and edges touch, the rows turn with it.
    cones : Cone or dict of str to Cone
        As in `margins`; the rows are those of their pyramids.

    Returns
    -------
    ConeRows
        Columns in the order and sign of `Solution.lam`, as the rows of `Terms.J`; zero where a
        constraint has no cone.

    Raises
    ------
    InvalidArgument, UnknownName
        As in `margins`.

    Notes
    -----
    Costs half a millisecond.
    """
    check_scene(scene)
    _check(cones, [scene])
    blocks, names = [], []
    for name, columns, cone, T, W in _grounded(scene, normalised(scene.robot.model, "q", q), cones):
        rows = cone.rows()
        blocks.append(np.zeros((len(rows.A), scene.rows)))
        blocks[-1][:, columns] = turned(T.T, rows.A) @ W.T
        names += [f"{name}: {row}" for row in rows.names]
    return ConeRows(np.vstack(blocks), tuple(names))


def turned(T: Array, force: Array) -> Array:
    """Return T f (...): forces (..., 3), or forces and moments (..., 6), three by three."""
    threes = force.reshape(*force.shape[:-1], force.shape[-1] // 3, 3)
    return np.asarray((threes @ np.swapaxes(T, -1, -2)).reshape(force.shape))


def _margins(scene: Scene, q: Array, lam: Array, noise: Array, cones: Cones) -> dict[str, Margin]:
    """Return the margins at the states q (..., nq) with the forces lam (..., m)."""
    return {
        name: cone.judge(turned(T, lam[..., rows] @ W), noise)
        for name, rows, cone, T, W in _grounded(scene, q, cones)
    }


def _margins_of_motion(motion: Trajectory, cones: Cones) -> dict[str, Margin]:
    """Return margins for each sample, infinite while a contact is away."""
    _check(cones, [phase.scene for phase in motion.phases])
    noise = np.full(len(motion), _noise(motion.lam, axis=None))
    four: dict[str, Array] = {}
    for phase in motion.phases:
        at, lam = phase.samples, motion.lam[phase.samples][:, list(phase.columns)]
        for name, part in _margins(phase.scene, motion.q[at], lam, noise[at], cones).items():
            whole = four.setdefault(name, np.full((len(FAULTS), len(motion)), np.inf))
            whole[:, at] = part.pulls, part.slips, part.tips, part.twists
    return {name: Margin(w[0], w[1], w[2], w[3], noise) for name, w in four.items()}


def _noise(lam: Array, axis: int | None) -> Array:
    """Return what counts as no force beside the largest of lam [N]."""
    sizes = np.abs(np.where(np.isfinite(lam), lam, 0.0))
    return np.asarray(tolerances.SOLVED * sizes.max(axis=axis, initial=0.0))


def _grounded(
    scene: Scene, q: Array, cones: Cones
) -> Iterator[tuple[str, slice, Cone, Array, Array]]:
    """Yield name, rows, cone, T and W of each contact: f = T (lam W) in the axes of the floor.

    T (..., 3, 3) is at q (..., nq); W (rows, 3 or 6) has what the kind does not transmit.
    """
    fitted = _fitted(scene, cones)
    equations, states = equations_of(scene), q.shape[:-1]
    R = np.zeros((len(fitted), *states, 3, 3))
    for state in np.ndindex(states):
        ends: list[Any] = equations.placements(q[state])
        for k, i in enumerate(fitted):
            R[(k, *state)] = ends[i][0].rotation
    for (i, cone), axes in zip(fitted.items(), R, strict=True):
        bound: Any = scene.bounds[i]
        W = np.array([bound.whole(row) for row in np.eye(bound.size)])
        T = cone.turn(scene.constraints[i], axes, upward(scene))
        yield bound.name, bound.rows, cone, T, W


def _fitted(scene: Scene, cones: Cones) -> dict[int, Cone]:
    """Return the cones of the contacts that are judged, by their places in the scene."""
    chosen = cones
    if not isinstance(chosen, Mapping):
        chosen = {c.name: chosen for c in scene.constraints if presses(c)}
    pairs = enumerate(scene.constraints)
    return {i: chosen[c.name].fitted(c) for i, c in pairs if c.name in chosen}


def _check(cones: Cones, scenes: Sequence[Scene]) -> None:
    """Refuse what is no cone, names that no scene knows, and scenes without a contact."""
    from condyn_pin.cones import Cone  # which imports this file

    named = cones if isinstance(cones, Mapping) else {"cones": cones}
    known = {name: None for scene in scenes for name in scene.names}
    for name, cone in named.items():
        if not isinstance(cone, Cone):
            raise InvalidArgument(f"{name} = {cone!r}: a FrictionCone or a WrenchCone is needed")
        if isinstance(cones, Mapping) and name not in known:
            raise unknown_name("constraint", name, known)
    if not any(_fitted(scene, cones) for scene in scenes):
        raise InvalidArgument("no contact to judge: nothing here presses on a floor")
