"""The legend of a picture: what its colours mean, and what could not be drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from condyn_pin.viewing import palette, three
from condyn_pin.viewing.balance_marks import POINTS
from condyn_pin.viewing.part import Part

# What the legend says, if all these parts are there.
_LEGEND = (
    (("joints/actuated",), palette.ACTUATED, "joint with a motor"),
    (("joints/passive",), palette.PASSIVE, "passive joint"),
    (("springs",), palette.SPRING, "spring-damper"),
    (("closures",), palette.CLOSED, "closed"),
    (("closures",), palette.OPEN, "open by 1 cm or more (yellow: by less)"),
    (("contacts",), palette.CONTACT, "contact"),
    (("candidates",), palette.CONTACT, "may touch"),
    (("touching",), palette.AWAY, "contact that is open"),
    (("touching",), palette.STICKS, "contact that sticks"),
    (("touching",), palette.SLIDES, "contact that slides"),
    (("grounds",), palette.GROUND, "what may be touched"),
    (("cones",), palette.CONE, "forces that friction can give"),
    (("forces",), palette.FORCE, "force on the first-named body"),
    (("forces", "closures"), palette.REACTION, "force on the other body"),
    (("moments",), palette.MOMENT, "moment"),
    (("balance/support",), palette.SUPPORT, "support polygon"),
    *(((f"balance/{name}",), colour, words) for name, words, colour in POINTS),
)


def legend_of(
    title: str, parts: Iterable[Part], squares: float, notes: Iterable[str]
) -> Iterator[tuple[str, str]]:
    """Yield colour and text of each line; `squares` are those of the floor [m]."""
    yield "", title
    paths = [part.path for part in parts]
    seen = {path.removeprefix("before/").split("/")[0] for path in paths}
    seen |= {"/".join(path.split("/")[:2]) for path in paths}
    for needed, colour, text in _LEGEND:
        if seen.issuperset(needed):
            yield f"#{three.number(colour):06x}", text
    yield "", f"squares of {squares:g} m"
    yield from (("", note) for note in notes)
