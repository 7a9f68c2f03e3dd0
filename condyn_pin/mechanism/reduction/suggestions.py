"""What may be left out of a scene: simplifications to try, those that are exact first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from functools import partial

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import indices
from condyn_pin._core.linalg.minimum_norm import factorise
from condyn_pin._core.names import listed
from condyn_pin.mechanism.reduction.linkages import follows, without_linkage
from condyn_pin.mechanism.reduction.merging import merge_points
from condyn_pin.mechanism.reduction.planar import as_planar
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene
from condyn_pin.mechanism.reduction.reduction import without
from condyn_pin.mechanism.reduction.rods import is_rod, rods_as_distances
from condyn_pin.model.smaller_robot import free_flyers


@dataclass(frozen=True)
class Suggestion:
    """A simplification: what it is in words, and how it is made."""

    what: str
    make: Callable[[ReducedScene], ReducedScene]


def suggestions(
    scene: ReducedScene, moving: Set[str], asked: Sequence[str], *, exact_rows: bool
) -> Iterator[Suggestion]:
    """Yield what may be left out of a scene.

    Parameters
    ----------
    scene : ReducedScene
    moving : set of str
        Joints that have to move.
    asked : sequence of str
        Joints whose accelerations are asked for: they are kept.
    exact_rows : bool
        Whether the solver takes every kind of constraint with its own rows; if not, kinds that it
        would refuse, or make of more rows again, are not proposed.
    """
    still = [n for n in scene.robot.joints if n not in moving and n not in asked]
    if still and len(still) < len(scene.robot.joints):
        index, _ = indices(scene.full.robot.model, scene.robot.joints)
        q = np.array(scene.held)[index]
        yield Suggestion(
            f"joints that do not move locked: {listed(still)}", lambda s: s.lock(still, q)
        )
    if merge_points(scene, edges=exact_rows).rows < scene.rows:
        yield Suggestion(
            "points on one body merged into one contact", partial(merge_points, edges=exact_rows)
        )
    for name in _implied(scene):
        yield Suggestion(
            f"constraint {name} left out: the others imply it", partial(_without, name=name)
        )
    for loop, joints in _linkages(scene, asked):
        yield Suggestion(
            f"loop {loop} left out, and {listed(joints)} that only follow it reflected",
            partial(_without_linkage, loop=loop, joints=joints),
        )
    if not exact_rows:
        return
    for name in scene.robot.joints:
        if name not in asked and is_rod(scene, name):
            yield Suggestion(f"rod on {name} as a distance", partial(_as_distance, joint=name))
    for name in _planar_balls(scene):
        yield Suggestion(
            f"loop {name} as a planar pin: its third row is redundant",
            partial(as_planar, name=name),
        )


def _without(scene: ReducedScene, name: str) -> ReducedScene:
    return without(scene, [name])


def _without_linkage(scene: ReducedScene, loop: str, joints: Sequence[str]) -> ReducedScene:
    return without_linkage(scene, [loop], joints)


def _as_distance(scene: ReducedScene, joint: str) -> ReducedScene:
    return rods_as_distances(scene, [joint])


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
    for bound in scene.bounds:
        loop = next(c for c in scene.constraints if c.name == bound.name)
        if loop.as_planar_pin(loop.name) is not None:
            own: Array = J[bound.rows]
            if factorise(M, own, tolerances.RANK).rank == 2:
                yield bound.name
