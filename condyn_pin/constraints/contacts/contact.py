"""Contract of a contact that may open, with gaps and rows.

    gap(q) >= 0,    lam_n >= 0,    gap lam_n = 0,    |lam_t| <= mu lam_n

A user holds a `Contact`, a frozen value. `bind` makes a `BoundContact` of it, on the joints of one
model; `Candidates` (`condyn_pin.constraints.contacts.candidates`) evaluates those of a scene
together. The rows of a contact are fixed, whatever it touches at a state.

To add a kind: one file. One frozen dataclass that inherits from `Contact`; it registers itself in
`CONTACTS` under its name, by which archives find it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from condyn_pin._core.arguments import check_type, register
from condyn_pin.constraints.constraint import (
    Constraint,
    FramedModel,
    GivenFields,
    MjcfGeomWriter,
    no_joint,
)
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.constraints.places import short_frames
from condyn_pin.errors import InvalidModel, UnsupportedConstraint

Mode = Literal["open", "slide", "stick"]

CONTACTS: dict[str, type[Contact]] = {}


@dataclass(frozen=True, kw_only=True)
class Contact(GivenFields, ABC):
    """Base of every contact that may open.

    Parameters
    ----------
    name : str, optional
        What forces and errors are listed under; after its frame or joint by default.
    """

    name: str = ""  # what forces and errors are listed under

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__:
            register(CONTACTS, cls.__name__, cls, f"a kind of contact named {cls.__name__}")

    def _set_name(self, default: str) -> None:
        check_type("name", self.name, str, "a text is needed")
        object.__setattr__(self, "name", self.name or short_frames(default))

    def owns(self, candidate: str) -> bool:
        """True if a `candidate` of this name belongs to the contact."""
        return candidate == self.name or candidate.startswith(f"{self.name}/")

    @abstractmethod
    def bind(self, machine: FramedModel) -> BoundContact:
        """Return the contact bound to the joints of a machine."""

    def with_held(self, values: Mapping[str, float]) -> Contact:
        """Return the contact with joints held at values: itself, unless these enter its gap."""
        return self

    @abstractmethod
    def held(self, modes: Mapping[str, Mode] | None) -> tuple[Constraint, ...]:
        """Return the constraints that hold the contact while its candidates stay in their modes.

        Parameters
        ----------
        modes : mapping of str to {"open", "slide", "stick"}, optional
            Of its candidates, by name; those that it leaves out are open. Without it everything
            that touches sticks, and stops are open.

        Raises
        ------
        UnsupportedConstraint
            If there is no such constraint.
        """

    def write_mjcf(self, to: MjcfGeomWriter) -> None:
        """Write the contact `to` a file for MuJoCo; by default MuJoCo has no equivalent."""
        raise InvalidModel(
            f"contact {self.name!r} is a {type(self).__name__}, for which MuJoCo has nothing; "
            "leave it out of contacts=[...]"
        )


# Joints by name, for what acts along their coordinates.


def joint_named(machine: FramedModel, name: str) -> Any:
    """Joint of the model, or UnknownName."""
    if name not in machine.joints:
        raise no_joint(machine, name)
    return machine.model.joints[machine.model.getJointId(name)]


def not_held(contact: Contact, joint: str, modes: Mapping[str, Mode] | None) -> tuple[()]:
    """No constraints; UnsupportedConstraint if a candidate of a joint sticks."""
    for candidate, mode in (modes or {}).items():
        if mode == "stick" and contact.owns(candidate):
            raise UnsupportedConstraint(
                f"{candidate}: a joint that sticks is no constraint; scene.lock([{joint!r}], q)"
            )
    return ()
