"""ContactWork: what contacts did to the energy of a motion, each part by its cause."""

from __future__ import annotations

from typing import Final, NamedTuple


class ContactWork(NamedTuple):
    """Work of contacts that open and slide, in a step or since the start of a run.

    Attributes
    ----------
    contact : float
        Friction and impacts; they only take [J].
    correction : float
        What pushes penetrations out, and moves q back onto the loops [J].
    algorithmic : float
        What impulses gave against the laws of contact, for a step knows J at one place only [J].
    """

    contact: float  # [J]
    correction: float  # [J]
    algorithmic: float  # [J]

    @property
    def total(self) -> float:
        """All of it [J]."""
        return self.contact + self.correction + self.algorithmic

    def plus(self, other: ContactWork) -> ContactWork:
        """Return the work of both."""
        return ContactWork(
            self.contact + other.contact,
            self.correction + other.correction,
            self.algorithmic + other.algorithmic,
        )

    def more(self, *, contact: float = 0.0, correction: float = 0.0) -> ContactWork:
        """Return it with more work of friction and impacts, and of corrections [J]."""
        return self.plus(ContactWork(contact, correction, 0.0))


NO_WORK: Final = ContactWork(0.0, 0.0, 0.0)
