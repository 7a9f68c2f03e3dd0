"""What may be left out of a scene: simplifications to try, those that are exact first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import listed
from condyn_pin._core.joints import indices
from condyn_pin._core.linalg import factorise
from condyn_pin.mechanism.reduction.fewer_rows import as_planar, merge_points
from condyn_pin.mechanism.reduction.linkages import follows, without_linkage
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene
from condyn_pin.mechanism.reduction.reduction import without
from condyn_pin.mechanism.reduction.rods import is_rod, rods_as_distances
from condyn_pin.model.smaller import free_flyers


@dataclass(frozen=True)
class Suggestion:
    """A simplification: what it is in words, and how it is made."""

    what: str
    make: Callable[[ReducedScene], ReducedScene]


def suggestions(
    scene: ReducedScene, moving: Set[str], asked: Sequence[str], *, exact_rows: bool
) -> Iterator[Suggestion]:
    """Yield what may be left out of a scene.

    Joints that are `moving` have to move, and those whose accelerations are `asked` for are kept.
    Without `exact_rows` the solver would refuse some kinds of constraints, or make more rows of
    them again: these are not proposed.
    """
    still = [n for n in scene.robot.joints if n not in moving and n not in asked]
    if still and len(still) < len(scene.robot.joints):
        index, _ = indices(scene.full.robot.model, scene.robot.joints)
        yield Suggestion(
            f"joints that do not move locked: {listed(still)}",
            _applied(ReducedScene.lock, still, np.array(scene.held)[index]),
        )
    if merge_points(scene, edges=exact_rows).rows < scene.rows:
        yield Suggestion(
            "points on one body merged into one contact",
            _applied(merge_points, edges=exact_rows),
        )
    for name in _implied(scene):
        yield Suggestion(
            f"constraint {name} left out: the others imply it", _applied(without, [name])
        )
    for loop, joints in _linkages(scene, asked):
        yield Suggestion(
            f"loop {loop} left out, and {listed(joints)} that only follow it reflected",
            _applied(without_linkage, [loop], joints),
        )
    if not exact_rows:
        return
    for name in scene.robot.joints:
        if name not in asked and is_rod(scene, name):
            yield Suggestion(f"rod on {name} as a distance", _applied(rods_as_distances, [name]))
    for name in _planar_balls(scene):
        yield Suggestion(
            f"loop {name} as a planar pin: its third row is redundant",
            _applied(as_planar, name),
        )


def _applied(
    simplify: Callable[..., ReducedScene], *args: Any, **options: Any
) -> Callable[[ReducedScene], ReducedScene]:
    """Return a function of a scene that simplifies it so."""
    return lambda scene: simplify(scene, *args, **options)


def _implied(scene: ReducedScene) -> Iterator[str]:
    """Yield constraints without which the rank is the same."""
    terms = scene.nominal.terms
    for bound in scene.bounds:
        others = np.delete(terms.J, bound.rows, axis=0)
        if factorise(terms.M, others, tolerances.RANK).rank == scene.nominal.rank:
            yield bound.name


def _linkages(scene: ReducedScene, asked: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield loops with the passive branch that ends in one of their sides."""
    model = scene.robot.model
    sprung = [spring.joint for spring in scene.robot.springs]
    busy = [j for c in scene.constraints for j in set(c.sides(scene.robot))]
    kept = {*asked, *scene.robot.actuated, *sprung, *free_flyers(scene.robot)}
    for loop in scene.constraints:
        if not loop.is_pin:
            continue
        for end in loop.sides(scene.robot):
            joints: list[str] = []
            allowed = 1  # constraints on the body: the loop itself, then none
            while (
                end
                and model.names[end] not in kept
                and busy.count(end) == allowed
                and len(model.children[end]) == len(joints[-1:])
            ):
                joints.append(str(model.names[end]))
                end, allowed = model.parents[end], 0
            if joints and follows(scene, [loop.name], joints):
                yield loop.name, joints


def _planar_balls(scene: ReducedScene) -> Iterator[str]:
    """Yield ball loops with a redundant row of their own."""
    M, J = scene.nominal.terms.M, scene.nominal.terms.J
    for loop, bound in zip(scene.constraints, scene.bounds, strict=True):
        is_ball = loop.as_planar_pin(loop.name) is not None
        if is_ball and factorise(M, J[bound.rows], tolerances.RANK).rank == 2:
            yield bound.name
