"""Islands: contacts that feel each other, apart from those that they do not feel."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Indices
from condyn_pin.contact.problem import ContactProblem


def islands(problem: ContactProblem) -> list[tuple[Indices, ContactProblem]]:
    """Return the rows and the problem of each component of the graph of G.

    Two contacts feel each other if their block of G has a number that is not zero. What no impulse
    of the one does to the other is zero to the last bit where bodies share no joint, so that
    nothing is neglected. One island, the problem itself, where all are connected.
    """
    everything = np.arange(problem.rows)
    if problem.G.all() or len(problem.names) < 2:
        return [(everything, problem)]
    blocks = problem.sets.blocks
    felt = np.zeros((len(problem.names),) * 2, dtype=bool)
    np.logical_or.at(felt, np.ix_(blocks, blocks), problem.G != 0)
    # each contact takes the smallest number that it is connected to
    label = np.arange(len(felt))
    np.fill_diagonal(felt, True)
    while True:
        least = np.where(felt, label, len(felt)).min(axis=1)
        if (least == label).all():
            break
        label = least
    if not label.any():
        return [(everything, problem)]
    return [_part(problem, np.flatnonzero(label == each)) for each in np.unique(label)]


def _part(problem: ContactProblem, contacts: Indices) -> tuple[Indices, ContactProblem]:
    """Return the rows of some contacts, and the problem that they are by themselves."""
    rows = np.flatnonzero(np.isin(problem.sets.blocks, contacts))
    k, lines = len(problem.friction), problem.half_lines
    cones, intervals = contacts[contacts < k], contacts[contacts >= k + lines]
    part = ContactProblem.trusted(
        G=problem.G[np.ix_(rows, rows)],
        g=problem.g[rows],
        friction=problem.friction[cones],
        half_lines=len(contacts) - len(cones) - len(intervals),
        limits=problem.limits[intervals - k - lines],
        R=None if problem.R is None else problem.R[rows],
        law=problem.law,
        level=problem.level,
        names=tuple(problem.names[i] for i in contacts),
    )
    return rows, part
