"""A contact scene as all peers read it: MJCF, a start, and where its bodies have to be.

Numpy and the standard library only: the same file in every environment.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

TEXT, MODEL = "contact.json", "contact.xml"


@dataclass(frozen=True)
class ContactScene:
    """Bodies on a floor.

    Attributes
    ----------
    name : str
    error : str
        What the error is [m].
    bodies : tuple of str
        Whose positions count: names of bodies of the MJCF file, which has the start as a keyframe.
    times : tuple of float
        When they count [s]; the last one is the end.
    truth : nested tuple of float
        (times, bodies, 3), centres of mass in the world [m].
    steps : tuple of float
        dt that divide all times [s].
    friction, restitution : float
        Of all contacts [1].
    folder : Path
        Where the files are.
    """

    name: str
    error: str
    bodies: tuple[str, ...]
    times: tuple[float, ...]
    truth: Any
    steps: tuple[float, ...]
    friction: float
    restitution: float
    folder: Path = Path()

    @property
    def model(self) -> Path:
        """The MJCF file."""
        return self.folder / MODEL

    @property
    def duration(self) -> float:
        """The end [s]."""
        return self.times[-1]

    def distance(self, positions: np.ndarray) -> float:
        """Return the largest distance of a body from where it has to be [m]; inf if one is lost."""
        found = np.asarray(positions, dtype=float)
        if not np.isfinite(found).all():
            return float("inf")
        return float(np.linalg.norm(found - np.array(self.truth), axis=2).max())

    def counts(self, dt: float) -> list[int]:
        """Return how many steps lead from each time to the next, from 0 on."""
        ends = np.round(np.array(self.times) / dt).astype(int)
        return [int(n) for n in np.diff(ends, prepend=0)]

    def save(self, model: str) -> None:
        """Write both files."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.model.write_text(model, encoding="utf-8")
        plain = asdict(replace(self, folder=Path())) | {"folder": ""}
        (self.folder / TEXT).write_text(json.dumps(plain), encoding="utf-8")


def load(folder: Path) -> ContactScene:
    """Return a scene that was saved."""
    saved = json.loads((folder / TEXT).read_text(encoding="utf-8"))
    lists = {key: tuple(saved[key]) for key in ("bodies", "times", "steps")}
    return ContactScene(**saved | lists | {"folder": folder})
