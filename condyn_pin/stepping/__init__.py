"""Steps with contacts, and motion between the events of contacts.

    M (v' - v) = dt (tau - h) + J^T lam,    contacts: lam in K, J v' in K* to first order

Nouns: contact schemes, a file each in `schemes/`; `StepSolution`, `BatchStep`. Verbs: `step`,
`step_batch`, `contact_problem`.

It must not know how an answer changes with its question.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
