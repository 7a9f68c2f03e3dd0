"""URDF as text, for tests: a bar on two hinges, cut at one of its ends."""

from __future__ import annotations

INERTIA = '<inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/>'


def link(name: str, inside: str | None = None) -> str:
    inertial = f'<inertial><origin xyz="0 0 -0.25"/><mass value="1"/>{INERTIA}</inertial>'
    return f'<link name="{name}">{inertial if inside is None else inside}</link>'


def joint(name: str, parent: str, child: str, inside: str = "", kind: str = "continuous") -> str:
    inside = inside if "<axis" in inside else f'{inside}<axis xyz="0 1 0"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def tip(name: str, parent: str, xyz: str) -> str:
    """Return a link fixed to another one, as onshape-to-robot writes a frame."""
    moments = " ".join(f'{key}="0"' for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    empty = f'<inertial><mass value="1e-9"/><inertia {moments}/></inertial>'
    at = f'<origin xyz="{xyz}"/>'
    return link(name, empty) + joint(f"{name}_frame", parent, name, at, "fixed")


SWING = (
    link("beam", ""),
    *(link(name) for name in "abc"),
    joint("left", "beam", "a"),
    joint("right", "beam", "b", '<origin xyz="0.5 0 0"/>'),
    joint("bottom", "a", "c", '<origin xyz="0 0 -0.5"/>'),
    tip("closing_bar_1", "c", "0.5 0 0"),
    tip("closing_bar_2", "b", "0 0 -0.5"),
)
