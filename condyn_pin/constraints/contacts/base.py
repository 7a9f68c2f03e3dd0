"""The contract of a contact: what may let go, and is asked for gaps and rows.

    gap(q) >= 0,    lam_n >= 0,    gap lam_n = 0,    |lam_t| <= mu lam_n

A user holds a `Contact`, a frozen value. `bind` makes a `BoundContact` of it, on the joints of one
model; `Candidates` (`condyn_pin.constraints.contacts.candidates`) evaluates those of a scene
together. The rows of a contact are fixed, whatever it touches at a state.

To add a kind: one file. One frozen dataclass that inherits from `Contact`; it registers itself in
`CONTACTS` under its name, by which archives find it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from condyn_pin._core.registry import enter
from condyn_pin.constraints.contacts.bound import BoundContact
from condyn_pin.constraints.protocols import Machine
from condyn_pin.errors import InvalidArgument

CONTACTS: dict[str, type[Contact]] = {}


@dataclass(frozen=True, kw_only=True)
class Contact(ABC):
    """What every contact that may let go has: a name, and a way onto the joints of a model."""

    name: str = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__:
            enter(CONTACTS, cls.__name__, cls, f"a kind of contact named {cls.__name__}")

    def _set_name(self, default: str) -> None:
        if not isinstance(self.name, str):
            raise InvalidArgument(f"name = {self.name!r}: a text is needed")
        object.__setattr__(self, "name", self.name or default)

    @abstractmethod
    def bind(self, machine: Machine) -> BoundContact:
        """Return it on the joints of a machine."""
