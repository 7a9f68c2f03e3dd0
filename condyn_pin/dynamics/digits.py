"""Digits: the rank that a file means, where the digits of its numbers make up more.

Files round: 1.5708 for pi/2 puts an axis 3.7e-6 rad off parallel, and of a linkage in a plane a
hinge makes a structure. A rounding leaves a singular value of its own size at *every* closed state,
and a gap that no motion closes; a dead point makes one small at one posture only. With r the number
of singular values of A = R J D (`condyn_pin.constraints.rows.redundancy`) above 1e-3 of the largest

    s_(r+1) < 1e-3 s_1    and    |R c| <= g        at five states along the motion of r rows,

each closed by r rows, r is the rank of a scene whose geometry is known to g. Up to the precision of
the robot it is taken: the other rows stay left out, closed or not, and closed means

    |P c| <= 1e-10    with    |N^T R c| <= precision,      P = 1 - N N^T.

Beyond it the file is believed, and a notice names what is off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, log10, pi
from typing import Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import count_text
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import rank_of
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.redundancy import (
    TIMES_THE_PRECISION,
    Redundancy,
    RedundantRows,
    scales,
)
from condyn_pin.dynamics.scene import Scene

# States, how far they are from each other [rad, l], how often that is halved where the loops do not
# close, and Newton's steps that close them.
_STATES, _MOVED, _HALVINGS, _NEWTON_STEPS = 5, 0.15, 3, 12

# How often r is counted anew, at a state where more rows count or fewer.
_COUNTS: Final = 3

# Angles between axes of one loop [rad], and lengths off its plane, that a notice names.
_MEANT: Final = 1e-2
_EXACT: Final = 1e-10

# Angles that a gap is laid to, in units of it: 0.9 to 3 in linkages that were looked at.
_AS_FAR: Final = 30.0

# Loops that are named.
_MOST: Final = 3

# Kinds of loops that `planar` can stand for.
_PINS: Final = ("ball", "hinge")

# Share of the largest part in what is left out below which a loop is not named.
_NAMED: Final = 0.1

# Numbers of files that stand for others, and what these are.
_WRITTEN: Final = {
    text: (name, turn * pi / 2)
    for turn, name in ((1, "pi/2"), (2, "pi"))
    for text in (f"{turn * pi / 2:.{digits}f}" for digits in range(2, 7))
}


@dataclass(frozen=True, eq=False)
class Digits:
    """Spurious rank of a scene, from the rounded numbers of its file."""

    # with the rank that the file means; None where the file is believed
    redundancy: Redundancy | None
    gap: float  # what the rows beyond that rank leave open at most [rad, sizes of a loop]
    note: str  # what is off, by how much, what follows, and the cure


class _WalkState(NamedTuple):
    """A closed state on the walk: q, c, J and the scaled singular values."""

    q: Array
    c: Array
    J: Array
    S: Array


def digits_at(scene: Scene, rows: Equations, q: Array, *, J: Array | None = None) -> Digits | None:
    """Spurious rank from rounded numbers, at a state with loops closed or open by little."""
    # None where they make up nothing: no singular value is small, or not at states nearby. J (m,
    # nv) says that the loops are closed at q, so that only its singular values are looked at first.
    precision = scene.robot.precision
    if precision == 0.0 or not rows.m:
        return None
    if J is not None:
        R, D, _ = scales(rows, q, J)
        S = np.linalg.svd(R[:, None] * J * D, compute_uv=False)
        if rank_of(S, tolerances.LEAST_PRECISE) == rank_of(S, tolerances.REFERENCE_RANK):
            return None
    scaled = Redundancy.of(rows, q, rows.cancellation(q), 0, closed=False)
    walked = _walk_of_file(rows, scaled, q)
    if walked is None:
        return None
    r, states = walked
    gaps = np.max([np.abs(scaled.R * at.c) for at in states], axis=0)
    gap = float(gaps.max())
    pivot = max(float(at.S[r]) if r < len(at.S) else 0.0 for at in states)
    if not tolerances.CLOSED < gap < tolerances.LEAST_PRECISE:  # rows that close count
        return None
    if gap <= precision and pivot > TIMES_THE_PRECISION * precision:
        return None
    left = scaled.left_out(states[0].J, states[0].c, r)
    about = scene, rows, gaps, states[0], left
    if gap > precision:
        return Digits(None, gap, _note(*about, believed=gap))
    taken = replace(scaled, floor=r, digits=r, gap=gap, precision=precision)
    return Digits(taken, gap, _note(*about))


def _walk_of_file(
    rows: Equations, scaled: Redundancy, q: Array
) -> tuple[int, list[_WalkState]] | None:
    """The rank r that the file means and closed states, if the others are small at all of them."""
    r = rank_of(scaled.singular_values(rows.position_level(q)[1]), tolerances.LEAST_PRECISE)
    for _ in range(_COUNTS):
        if not 0 < r < rows.model.nv or r == rows.m:
            return None
        states = _walk(rows, scaled, q, r)
        if not states:
            return None
        counts = [rank_of(at.S, tolerances.LEAST_PRECISE) for at in states]
        if max(counts) == r:
            return r, states
        q, r = states[int(np.argmax(counts))].q, max(counts)
    return None


def _walk(rows: Equations, scaled: Redundancy, q: Array, r: int) -> list[_WalkState]:
    """States along the motion that r rows leave, closed by them; none where q cannot be closed."""
    rng = np.random.default_rng(0)
    at = _closed_by(rows, scaled, q, r)
    states = [] if at is None else [at]
    while states and len(states) < _STATES:
        x, size = rng.normal(size=rows.model.nv), _MOVED
        for _ in range(_HALVINGS):
            move = scaled.free_move(states[-1].J, x, size, r)
            at = _closed_by(rows, scaled, pin.integrate(rows.model, states[-1].q, move), r)
            if at is not None:
                break
            size /= 2
        if at is None:
            return []
        states.append(at)
    return states


def _closed_by(rows: Equations, scaled: Redundancy, q: Array, r: int) -> _WalkState | None:
    """The state at which r rows are closed, by Newton's method from q; None if they are not."""
    for _ in range(_NEWTON_STEPS):
        c, J = rows.position_level(q)
        move = scaled.closing_move(J, c, r)
        if not np.isfinite(move).all():
            return None
        if np.abs(move / scaled.D).max() <= tolerances.CLOSED:
            return _WalkState(q, c, J, scaled.singular_values(J))
        q = np.array(pin.integrate(rows.model, q, move))
    return None


class _LoopDefect(NamedTuple):
    """Defect of a loop in words, the property assumed in spite of it, and if the loop is planar."""

    text: str
    taken: str
    planar: bool


def _note(
    scene: Scene,
    rows: Equations,
    gaps: Array,
    at: _WalkState,
    left: RedundantRows,
    *,
    believed: float = 0.0,
) -> str:
    """Notice of the loops that are off, what follows, and the cure."""
    # A motion leaves rows open by `gaps` (m,) [rad, l]; where the file is believed, `believed` is
    # the largest.
    weights = np.linalg.norm(left.N, axis=1)
    found = []
    pin.computeJointJacobians(rows.model, rows.data, at.q)
    for bound, constraint in zip(rows.bounds, scene.constraints, strict=True):
        gap = float(gaps[bound.rows].max(initial=0.0))
        if weights[bound.rows].max(initial=0.0) <= _NAMED * weights.max() or gap <= _EXACT:
            continue
        off = _axis_defect(rows, bound, constraint.frames, gap)
        if off is None:
            text = f"closes but for {_short_number(gap)} rad or sizes of the loop"
            off = _LoopDefect(text, "redundant", False)
        what = "loop" if constraint.closes else "constraint"
        text = f"{what} {bound.name!r} ({constraint.called}): {off.text}"
        found.append(off._replace(text=text, planar=off.planar and constraint.called in _PINS))
    more = f"; and {count_text(len(found) - _MOST, 'more loop')}" if len(found) > _MOST else ""
    what = "; ".join(off.text for off in found[:_MOST]) + more
    taken = " and ".join(dict.fromkeys(off.taken for off in found))
    instead = "use kind='planar', " if all(off.planar for off in found) else ""
    free = rows.model.nv - left.rank
    if not believed:
        cure = f"{instead}write all digits, or precision=0"
        return (
            f"{what}; taken as {taken}: rank {left.rank} of {rows.m}, mobility {free}. "
            f"{cure[0].upper()}{cure[1:]}"
        )
    lost = rank_of(at.S, tolerances.REFERENCE_RANK) - left.rank
    lose = f": {lost} of {free} freedoms is lost to that" if lost > 0 else ""
    return (
        f"{what}{lose}; if they are meant to be {taken}, {instead}write all digits, or say how "
        f"right the file is: precision=1e{ceil(log10(believed))} of Robot and load_robot"
    )


def _axis_defect(
    rows: Equations, bound: BoundConstraint, frames: Sequence[str], gap: float
) -> _LoopDefect | None:
    """Axes of a loop that are off parallel or square as its gap says, or a gap off its plane."""
    ends = bound.ends(rows.data.oMi)
    if bound.joints is None or ends is None:
        return None
    axes = list(_axes(rows, bound.joints))
    turning = [axis for _, axis, turns in axes if turns]
    planar = len(turning) > 1 and all(_angle(turning[0], axis) < _MEANT for axis in turning)
    pairs = [pair for pair in _pairs(axes) if _EXACT < pair[3] < _AS_FAR * gap]
    hinge = bound.hinge_axis
    if planar and hinge is not None and not pairs:
        there = zip(frames[:: int(bound.sign)], ends, strict=True)
        own = [(frame, end.rotation[:, hinge], True) for frame, end in there]
        pairs = [pair for pair in _pairs([*axes, *own]) if _EXACT < pair[3] < _AS_FAR * gap]
    if pairs:
        one, other, how, off = max(pairs, key=lambda pair: round(pair[3], 9))
        text = (
            f"axes of {one!r} and {other!r} are off {how} by {_short_number(off)} rad{_hint(off)}"
        )
        return _LoopDefect(text, how, planar)
    across = abs(float(turning[0] @ (ends[0].translation - ends[1].translation))) if planar else 0.0
    if not across > _EXACT:
        return None
    return _LoopDefect(f"closes but for {_length(across)} across its plane", "in the plane", planar)


def _axes(rows: Equations, ends: tuple[int, int]) -> Iterator[tuple[str, Array, bool]]:
    """Joints of a loop with one axis, in order: name, axis in the world, and if it turns."""
    model, J = rows.model, rows.data.J
    one, two = (list(model.supports[joint]) for joint in ends)
    common = set(one) & set(two)
    around = [j for j in one if j not in common] + [j for j in two[::-1] if j not in common]
    for joint in around:
        if model.nvs[joint] == 1:
            column = J[:, model.idx_vs[joint]]
            turns = bool(np.linalg.norm(column[3:]))
            axis = column[3:] if turns else column[:3]
            yield model.names[joint], axis / np.linalg.norm(axis), turns


def _pairs(axes: Sequence[tuple[str, Array, bool]]) -> Iterator[tuple[str, str, str, float]]:
    """Neighbours in a loop whose axes are nearly parallel, or a slide's square to a turn's."""
    for (one, x, turns), (other, y, too) in zip(axes, [*axes[1:], *axes[:1]], strict=True):
        off, how = _angle(x, y), "parallel"
        if turns != too:
            off, how = abs(pi / 2 - off), "square"
        if off < _MEANT:
            yield one, other, how, off


def _angle(x: Array, y: Array) -> float:
    """Angle between two lines [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(x, y)), abs(x @ y)))


def _hint(off: float) -> str:
    """Number of a file that is off by this angle, in brackets; or nothing."""
    for text, (name, exact) in _WRITTEN.items():
        if abs(abs(float(text) - exact) - off) < 0.02 * off:
            return f" ({text} for {name}?)"
    return ""


def _short_number(x: float) -> str:
    return f"{x:.2g}".replace("e-0", "e-")


def _length(x: float) -> str:
    """Length [m] in words."""
    for size, unit in ((1e-6, "nm"), (1e-3, "um"), (1.0, "mm")):
        if x < 0.999 * size:
            return f"{x / size * 1e3:.3g} {unit}"
    return f"{x:.3g} m"
