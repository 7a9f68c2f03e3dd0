"""Hard questions: families of scenes, states and contact problems from tame to absurd.

Each function marked with `extreme` enters `EXTREMES` under its name, each with `contact_extreme`
`CONTACT_EXTREMES`; `base.py` and `contacts.py` say what they must return. Both registries are in
the order of the names.
"""

from lab.extremes import bodies, contacts, loops, motion
from lab.extremes.base import EXTREMES
from lab.extremes.contacts import CONTACT_EXTREMES

for _registry in (EXTREMES, CONTACT_EXTREMES):
    for _name in sorted(_registry):
        _registry[_name] = _registry.pop(_name)  # type: ignore[assignment]

__all__ = ["CONTACT_EXTREMES", "EXTREMES", "bodies", "contacts", "loops", "motion"]
