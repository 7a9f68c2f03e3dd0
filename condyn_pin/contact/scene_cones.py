"""The verbs margins and cone_rows: all contacts of an answer, or of a scene, at once.

Contacts stay bilateral: a cone is judged here, and enforced nowhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin.contact.cone import FAULTS, Cone, ConeRows, Margin, turned
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import upward
from condyn_pin.errors import InvalidArgument, unknown_name

Cones: TypeAlias = Cone | Mapping[str, Cone]


def margins(answer: Any, cones: Cones) -> dict[str, Margin]:
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
    if hasattr(answer, "phases"):  # a motion, in which contacts come and go
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
    """Return the friction cones of a scene as rows for your own program: A lam <= b.

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


def _margins(scene: Scene, q: Array, lam: Array, noise: Array, cones: Cones) -> dict[str, Margin]:
    """Return the margins at the states q (..., nq) with the forces lam (..., m)."""
    return {
        name: cone.judge(turned(T, lam[..., rows] @ W), noise)
        for name, rows, cone, T, W in _grounded(scene, q, cones)
    }


def _margins_of_motion(motion: Any, cones: Cones) -> dict[str, Margin]:
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
        chosen = {c.name: chosen for c in scene.constraints if c.presses}
    pairs = enumerate(scene.constraints)
    return {i: chosen[c.name].fitted(c) for i, c in pairs if c.name in chosen}


def _check(cones: Cones, scenes: Sequence[Scene]) -> None:
    """Refuse what is no cone, names that no scene knows, and scenes without a contact."""
    named = cones if isinstance(cones, Mapping) else {"cones": cones}
    known = {name: None for scene in scenes for name in scene.names}
    for name, cone in named.items():
        if not isinstance(cone, Cone):
            raise InvalidArgument(f"{name} = {cone!r}: a FrictionCone or a WrenchCone is needed")
        if isinstance(cones, Mapping) and name not in known:
            raise unknown_name("constraint", name, known)
    if not any(_fitted(scene, cones) for scene in scenes):
        raise InvalidArgument("no contact to judge: nothing in this scene presses on a floor")
