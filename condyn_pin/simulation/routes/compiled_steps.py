"""Derivatives of steps with contacts by the compiled core: those of `ActiveSet`.

Steps that end elsewhere than along straight paths, and those whose modes or rank leave a doubt, are
Python's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.work import Arrays, Messages
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.simulation.batch.batch_step import STATUSES
from condyn_pin.simulation.batch.compiled_steps import (
    contacts_of,
    left_to_python,
    paths_of,
    rounded_plan,
    states_of,
)
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.base import Route
from condyn_pin.simulation.routes.linear_steps import falls, rows_with_a_place


def untaken_route(route: Route, wrt: Sequence[str]) -> Iterator[str]:
    """Yield what the core does not take of a route to derivatives, in words."""
    if type(route) is not ActiveSet:
        yield f"route = {route!r}: it has ActiveSet() alone"
    if "inertias" in wrt:
        yield "wrt: it has no derivatives by inertias"


@dataclass(frozen=True)
class DifferentiatedRows:
    """What the core does to some states of a `step_derivatives_batch`."""

    contacts: tuple[Contact, ...]
    dt: float  # [s]
    integrator: Integrator

    def __call__(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Fill the outputs; return the rows that are left to Python, and nothing to say."""
        count, shape = len(inputs["q0"]), outputs["codes"].shape
        done, codes, read = np.zeros(count, np.int32), *np.zeros((2, *shape), np.int32)
        contacts_of(workspace, self.contacts).differentiate(
            *states_of(workspace, inputs), plan=rounded_plan(self.integrator, self.dt),
            polished=tolerances.CONTACT_POLISHED, falls=falls(workspace.model, self.dt),
            placed=rows_with_a_place(workspace.bounds),
            q=outputs["q"], v=outputs["v"], lam=outputs["lam"], errors=outputs["errors"],
            modes=codes, done=done, dq=outputs["dq"], dv=outputs["dv"], margins=outputs["margins"],
            read_modes=read, threads=threads, **paths_of(workspace, self.dt),
        )  # fmt: skip
        outputs["codes"][:], outputs["read"][:] = codes, read
        outputs["q_end"][:], outputs["v_end"][:] = outputs["q"], outputs["v"]
        outputs["statuses"][:] = STATUSES.index(ContactStatus.OK)
        return left_to_python(workspace, inputs["v0"], outputs, done, self.dt), {}
