"""Chosen: the contacts that take part in a step."""

from __future__ import annotations

from functools import cached_property
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Indices
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import ContactProblem, ContactSets, scale_of, stiffness_of
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme, Near


class Chosen:
    """The candidates that take part in a step, and what a contact problem says of them."""

    def __init__(self, candidates: Candidates, active: NDArray[np.bool_], dt: float) -> None:
        cones = candidates.cones
        lines = cones + candidates.half_lines
        self.active, self.rows = active, _all_or(candidates.rows_of(active))
        self.near, self.is_everything = active[:lines], bool(active.all())
        self.gaps = _all_or(self.near)
        self.over_planes = _all_or(active[: candidates.contact_points])
        self.contact_points = np.count_nonzero(active[: candidates.contact_points])
        k, stops = np.count_nonzero(active[:cones]), np.count_nonzero(active[cones:lines])
        self.normals: Indices | slice = slice(2, 3 * k, 3)
        if stops:
            self.normals = np.concatenate((np.arange(2, 3 * k, 3), 3 * k + np.arange(stops)))
        self.restitution = np.zeros(k + stops)
        self.restitution[:k] = candidates.restitution[active[:cones]]
        self.cones = _all_or(active[:cones])
        self.friction = candidates.friction[active[:cones]]
        self.half_lines = int(stops)
        self.limits = candidates.limits[active[lines:]] * dt  # [N s]
        self.names = tuple(compress(candidates.names, active))
        self.sets = ContactSets(self.friction, self.half_lines, self.limits)

    def impact(self, near: Near) -> ContactProblem:
        """Return the cones and half-lines of a step as they are before it: g is J_c v."""
        m = self._striking.size
        return ContactProblem.trusted(
            G=near.G[:m, :m], g=near.before[:m], friction=self.friction,
            half_lines=self.half_lines, limits=self._striking.limits, R=None, law="ncp",
            level="impulse", names=self.names[: len(near.gaps)], sets=self._striking,
        )  # fmt: skip

    @cached_property
    def _striking(self) -> ContactSets:
        return ContactSets(self.friction, self.half_lines, np.zeros(0))

    def problem(self, scheme: ContactScheme, near: Near) -> ContactProblem:
        """Return the contact problem of a step."""
        g, R = scheme.asked(near)
        stiffness = stiffness_of(near.G, R)  # what is asked for in any case takes longer if cached
        return ContactProblem.trusted(
            G=near.G, g=g, friction=self.friction, half_lines=self.half_lines, limits=self.limits,
            R=R, law=scheme.law, level="impulse", names=self.names, sets=self.sets,
            stiffness=stiffness, scale=scale_of(stiffness, g),
        )  # fmt: skip


def _all_or(some: NDArray[np.bool_]) -> NDArray[np.bool_] | slice:
    """Return flags, or the slice of everything where all are set, which copies nothing."""
    return slice(None) if some.all() else some
