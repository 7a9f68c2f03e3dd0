"""ContactWork: what steps with contacts did to the energy of a motion, each part by its cause."""

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
    driven : float
        Constraints that follow a path of time [J].
    """

    contact: float  # [J]
    correction: float  # [J]
    algorithmic: float  # [J]
    driven: float = 0.0  # [J]

    @property
    def total(self) -> float:
        """All of it [J]."""
        return self.contact + self.correction + self.algorithmic + self.driven

    def plus(self, other: ContactWork) -> ContactWork:
        """Return the work of both."""
        return ContactWork(
            self.contact + other.contact,
            self.correction + other.correction,
            self.algorithmic + other.algorithmic,
            self.driven + other.driven,
        )

    def more(
        self, *, contact: float = 0.0, correction: float = 0.0, driven: float = 0.0
    ) -> ContactWork:
        """Return it with more work of friction and impacts, corrections, and drives [J]."""
        return self.plus(ContactWork(contact, correction, 0.0, driven))


NO_WORK: Final = ContactWork(0.0, 0.0, 0.0)
