"""Variants of a robot: pieces of its card, by option and value, that are merged over it.

    [variants.springs.free]
    [variants.springs.locked.description]
    lock = ["left-knee-shin-joint"]

The first value of an option is its default. A piece has the entries of the card itself: tables are
merged, lists grow, and the rest is replaced.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name


def chosen_card(card: Mapping[str, Any], variant: Mapping[str, str]) -> dict[str, Any]:
    """Return a card with the chosen values of its options, and the defaults of the others.

    Parameters
    ----------
    card : mapping
        A robot.toml, as read.
    variant : mapping of str to str
        Option to value, such as ``{"springs": "locked"}``.

    Raises
    ------
    UnknownName
        If the robot has no such option, or the option no such value.
    """
    options = card.get("variants", {})
    _check_options(options)
    check_variant(variant, options)
    merged = {key: entry for key, entry in card.items() if key != "variants"}
    other = []  # what is not the default, for the name
    for option, values in options.items():
        default = next(iter(values))
        value = variant.get(option, default)
        if value not in values:
            raise unknown_name(f"value of the variant {option!r}", value, values)
        merged = _merged(merged, values[value], f"variants.{option}.{value}")
        if value != default:
            other.append(f"{option} {value}")
    if other:
        merged["name"] = f"{merged['name']}, {', '.join(other)}"
    return merged


def _check_options(options: Any) -> None:
    """Refuse what is not a table of options, each a table of values, each a table of entries."""
    if not isinstance(options, Mapping):
        raise InvalidModel(f"the entry variants = {options!r}: tables by option are needed")
    for option, values in options.items():
        pieces = list(values.values()) if isinstance(values, Mapping) else []
        if not pieces or not all(isinstance(piece, Mapping) for piece in pieces):
            raise InvalidModel(
                f"the entry variants.{option} = {values!r}: a table for each value is needed, "
                f"such as [variants.{option}.default]"
            )


def check_variant(variant: Any, options: Mapping[str, Any]) -> None:
    """Refuse what is not a choice among the options of a robot."""
    pairs = variant.items() if isinstance(variant, Mapping) else [(None, None)]
    if not all(isinstance(name, str) for pair in pairs for name in pair):
        raise InvalidArgument(
            f"variant = {variant!r}: names by name are needed, such as {{'springs': 'locked'}}"
        )
    for option in variant:
        if option not in options:
            raise unknown_name("variant", option, options)


def _merged(below: Mapping[str, Any], above: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a table with another one over it."""
    merged = dict(below)
    for key, entry in above.items():
        old = below.get(key, entry)
        if any(isinstance(old, kind) != isinstance(entry, kind) for kind in (Mapping, list)):
            raise InvalidModel(f"the entry {where}.{key} = {entry!r} does not fit over {old!r}")
        if isinstance(old, Mapping):
            merged[key] = _merged(old, entry, f"{where}.{key}")
        elif isinstance(old, list) and key in below and not _is_value(old):
            merged[key] = [*old, *entry]
        else:
            merged[key] = entry
    return merged


def _is_value(entry: list[Any]) -> bool:
    """Whether a list is one value, such as the quaternion of a posture, and no collection."""
    return all(isinstance(x, (int, float)) for x in entry)
