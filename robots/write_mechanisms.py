"""Write the mechanisms of this folder as MJCF: ``<name>/<name>.xml``.

    python robots/write_mechanisms.py

The geometry is in ``writing/``. The files keep to the plain part of MJCF that every reader agrees
on: one root body fixed to the world, one joint a body, explicit inertias, no shapes, and loops as
named <connect> that are closed as drawn. Postures are <key>, motors are <motor>. Lengths are in m,
masses in kg, angles in rad.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from writing.andrews import andrews
from writing.mjcf import Mjcf
from writing.planar import five_bar, parallelogram
from writing.spatial import bricard, delta, stewart

MECHANISMS: tuple[Callable[[], Mjcf], ...] = (
    andrews, bricard, delta, five_bar, parallelogram, stewart,
)  # fmt: skip


def main() -> None:
    """Write every file."""
    for mechanism in MECHANISMS:
        folder = Path(__file__).parent / mechanism.__name__
        folder.mkdir(exist_ok=True)
        (folder / f"{folder.name}.xml").write_text(mechanism().text(), encoding="utf-8")


if __name__ == "__main__":
    main()
