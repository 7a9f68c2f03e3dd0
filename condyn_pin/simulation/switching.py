"""Switch: from one set of constraints to another, touch-down and lift-off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from numpy.typing import ArrayLike

from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.at_state import at_state
from condyn_pin.dynamics.impacts import Impact, Restitution, impact
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True, eq=False, repr=False)
class Switch:
    """The effect of a change of constraints: the new velocity, and the impact.

    Attributes
    ----------
    v : (nv,) array
        Velocity after it, with which the second scene goes on.
    added, dropped, kept : tuple of str
        Names of constraints. One that is changed under its name is dropped and added.
    impact : Impact or None
        What added constraints did; None if none was added, for then the velocity stays.
    before, after : Scene
    """

    v: Array
    added: tuple[str, ...]
    dropped: tuple[str, ...]
    kept: tuple[str, ...]
    impact: Impact | None
    before: Scene
    after: Scene

    @property
    def notices(self) -> tuple[str, ...]:
        """What deserves attention, a sentence each."""
        return self.impact.notices if self.impact else ()

    def __repr__(self) -> str:
        lost = f", {self.impact.energy_lost:.4g} J lost" if self.impact else ""
        return (
            f"Switch({self.after.robot.name}: added {listed(self.added) or 'nothing'}, "
            f"dropped {listed(self.dropped) or 'nothing'}{lost})"
        )


def switch(
    scene_before: Scene,
    scene_after: Scene,
    q: ArrayLike,
    v: ArrayLike,
    *,
    restitution: Restitution = 0.0,
) -> Switch:
    """Return the velocity of a robot just after its constraints change.

    M (v+ - v) = J^T lam,    J v+ = -e J v    of what is added,    J v+ = 0    of what is kept

    A touch-down is an impact of all constraints of the second scene, so closed constraints stay
    closed. A lift-off does not change the velocity.

    Parameters
    ----------
    scene_before, scene_after : Scene
        Two scenes of one robot.
    q, v : (nq,), (nv,) array_like
        The state at which they change.
    restitution : float or mapping of str to float
        As in `impact`, of the constraints that are added: those that are kept do not rebound.

    Returns
    -------
    Switch

    Raises
    ------
    InvalidArgument
        If the scenes are of different models, or as in `impact`.

    Notes
    -----
    Cost and source are those of `impact`.
    """
    for argument, scene in (("scene_before", scene_before), ("scene_after", scene_after)):
        check_scene(scene, argument)
    if scene_before.robot.model != scene_after.robot.model:
        raise InvalidArgument(
            f"scene_after: its robot {scene_after.robot.name!r} has another model than that of "
            "scene_before; a ReducedScene has reduce_state and expand_state"
        )
    old, new = set(scene_before.constraints), set(scene_after.constraints)
    added = tuple(c.name for c in scene_after.constraints if c not in old)
    met = None
    if added:
        if not isinstance(restitution, Mapping):
            restitution = dict.fromkeys(added, restitution)
        met = impact(scene_after, q, v, restitution=restitution)
    return Switch(
        v=met.v if met else at_state(scene_after, q, v).v,
        added=added,
        dropped=tuple(c.name for c in scene_before.constraints if c not in new),
        kept=tuple(c.name for c in scene_after.constraints if c in old),
        impact=met,
        before=scene_before,
        after=scene_after,
    )
