"""Islands: contacts that feel each other, apart from those that they do not feel."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Indices
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.sets import ContactSets


class Island(NamedTuple):
    """Contacts of a problem that feel each other and no others.

    Attributes
    ----------
    rows : (r,) array of int
        Of the problem.
    block : tuple of arrays
        The same as indices of G.
    sets : ContactSets
        Of these rows.
    names : tuple of str
        Of these contacts.
    contacts : (k,) array of int
        Their places among the names of the problem.
    """

    rows: Indices
    block: tuple[Indices, ...]
    sets: ContactSets
    names: tuple[str, ...]
    contacts: Indices

    def problem(self, whole: ContactProblem) -> ContactProblem:
        """Return the problem that they are by themselves."""
        return ContactProblem.trusted(
            G=whole.G[self.block], g=whole.g[self.rows], friction=self.sets.friction,
            half_lines=self.sets.half_lines, limits=self.sets.limits,
            R=None if whole.R is None else whole.R[self.rows], law=whole.law, level=whole.level,
            names=self.names, sets=self.sets,
        )  # fmt: skip


def islands(problem: ContactProblem) -> tuple[Island, ...]:
    """Return the components of the graph of G; none where all contacts are connected.

    Two contacts feel each other if their block of G has a number that is not zero. What no impulse
    of the one does to the other is zero to the last bit where bodies share no joint, so that
    nothing is neglected. Those of the last problems are kept: the next step often has the same.
    """
    G, sets, names = problem.G, problem.sets, problem.names
    if np.count_nonzero(G) == G.size or len(names) < 2:
        return ()
    starts = np.flatnonzero(np.diff(sets.blocks, prepend=-1))
    by_rows = np.logical_or.reduceat(G != 0, starts, axis=0)
    felt = np.logical_or.reduceat(by_rows, starts, axis=1)
    return _islands(sets, names, felt.tobytes())


@lru_cache(maxsize=16)
def _islands(sets: ContactSets, names: tuple[str, ...], pattern: bytes) -> tuple[Island, ...]:
    """Return the components of a graph of contacts, given by its matrix."""
    felt = np.frombuffer(pattern, dtype=bool).reshape(len(names), len(names))
    found = components(felt)
    if len(found) == 1:
        return ()
    return tuple(island_of(sets, names, np.flatnonzero(each)) for each in found)


def components(felt: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Return which contacts are in each component of a graph (k, k), of all contacts."""
    label = _labels(felt | np.eye(len(felt), dtype=bool))
    return [label == each for each in np.unique(label)]


def _labels(felt: NDArray[np.bool_]) -> Indices:
    """Return for each contact the smallest number of those that it is connected to."""
    label = np.arange(len(felt))
    while True:
        least = np.where(felt, label, len(felt)).min(axis=1)
        if (least == label).all():
            return label
        label = least


def island_of(sets: ContactSets, names: tuple[str, ...], contacts: Indices) -> Island:
    """Return some contacts of a problem, by their places among its names."""
    rows = np.flatnonzero(np.isin(sets.blocks, contacts))
    k, lines = len(sets.friction), sets.half_lines
    cones, intervals = contacts[contacts < k], contacts[contacts >= k + lines]
    stops = len(contacts) - len(cones) - len(intervals)
    its_sets = ContactSets(sets.friction[cones], stops, sets.limits[intervals - k - lines])
    its_names = tuple(names[i] for i in contacts)
    return Island(rows, np.ix_(rows, rows), its_sets, its_names, contacts)
