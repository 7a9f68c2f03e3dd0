"""Loops of a URDF by the names of its links and joints.

A URDF is a tree. Exporters cut each loop, and leave a frame on both sides of the cut:

    closing_NAME_1, closing_NAME_2         a ball `Loop`: onshape-to-robot exports these, placo
                                           closes them
    closedloopNAME_A, closedloopNAME_B     a weld, for the joint is in the tree beside it; a ball
                                           where a name says 3D, as in closedloop4_A_3D or
                                           closedloop3D_1A: the parallel robots of Gepetto

What the names leave open is said: a ball never locks a joint that could turn, and a weld does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Final

from condyn_pin.constraints.loop import Loop

_CLOSING: Final = re.compile(r"(?P<name>closing_.+)_(?P<half>[12])")
# The side stands last, or before 3D or 6D, with an underscore before it or without.
_CLOSED_LOOP: Final = re.compile(r"(?P<name>.*(?i:closed_?loop).*?)_?(?P<half>[AB])(?i:_[36]D)?")
_POINT: Final = re.compile(r"3D", re.IGNORECASE)


def closings(links: Iterable[str], joints: Iterable[str]) -> Iterator[Loop]:
    """Yield the loops that pairs of links close, or of joints whose names say so."""
    links = sorted(links)
    for name, first, second in _pairs(links, _CLOSING):
        yield Loop(first, second, "ball", name=name)
    for name, first, second in _pairs(sorted({*links, *joints}), _CLOSED_LOOP):
        point = _POINT.search(first) and _POINT.search(second)
        yield Loop(first, second, "ball" if point else "weld", name=name)


def alone(links: Iterable[str], joints: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the names that look like halves of a loop and close nothing, and why."""
    links, joints = set(links), set(joints)
    used = {end for loop in closings(links, joints) for end in (loop.frame_a, loop.frame_b)}
    for name in sorted((links | joints) - used):
        if name.startswith("closing_") and name in links:
            whole = _CLOSING.fullmatch(name)
            yield name, "its other half is missing" if whole else "it does not end in _1 or _2"
        elif _CLOSED_LOOP.fullmatch(name):
            yield name, "not just one name with A and one with B is like it"


def stem(name: str) -> str:
    """Return the name of the loop that a name is half of; nothing if it is none."""
    found = _CLOSING.fullmatch(name) or _CLOSED_LOOP.fullmatch(name)
    return found["name"] if found else ""


def _pairs(names: Iterable[str], rule: re.Pattern[str]) -> Iterator[tuple[str, str, str]]:
    """Yield the name of each loop with just one of each half, and both halves in their order."""
    halves: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        if found := rule.fullmatch(name):
            halves.setdefault(found["name"], []).append((found["half"].upper(), name))
    for name, found_halves in halves.items():
        if len(found_halves) == 2 and found_halves[0][0] != found_halves[1][0]:
            (_, first), (_, second) = sorted(found_halves)
            yield name, first, second
