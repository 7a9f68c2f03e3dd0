"""Table: the rows of a study, with the machine that they were measured on."""

from __future__ import annotations

from dataclasses import dataclass, field

from condyn_pin.machine import machine
from condyn_pin.trade.row import Row


@dataclass(frozen=True)
class Table:
    """What a study found.

    Attributes
    ----------
    rows : tuple of Row
    machine : dict of str to str
        Processor, system, versions and date.
    floors : dict of str to float
        By label of a scene, the error that `Reference` itself may have: rounding of M.
    """

    rows: tuple[Row, ...]
    machine: dict[str, str] = field(default_factory=machine)
    floors: dict[str, float] = field(default_factory=dict)
