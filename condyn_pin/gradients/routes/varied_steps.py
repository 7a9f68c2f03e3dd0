"""Steps of a scene that is made of something else: what noise in its parameters is taken of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.linear_steps import LinearizedStep
from condyn_pin.model.smaller import weighing
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import ContactSteps

# (t, q, v) -> q+, v+
Step = Callable[[float, Array, Array], tuple[Array, Array]]


class VariedSteps:
    """The steps of a scene by a parameter of it.

    Attributes
    ----------
    sizes : (k,) array
        What each number of the parameter is measured by: 1 of coefficients; those of `solref`; and
        of each body its mass m, m r and m r^2, with m r^2 the trace of its inertia. A body that
        weighs nothing is measured by the lightest.
    """

    def __init__(self, steps: LinearizedStep, parameter: str) -> None:
        self._steps, self._parameter = steps, parameter
        self._values = _values(steps, parameter)
        self.sizes = np.ones(len(self._values))
        if parameter == "solref":
            self.sizes = np.abs(self._values)
        elif parameter == "inertias":
            self.sizes = _weights(self._values.reshape(-1, 10))

    def at(self, change: Array) -> Step:
        """Return the steps with a change (k,) of the parameter."""
        values, name = self._values + change, self._parameter
        scheme, system = self._steps.scheme, self._steps.system
        if name == "solref":
            return self._by(replace(scheme, solref=tuple(values.tolist())), system)  # type: ignore[call-arg]
        if name == "inertias":
            return self._by(scheme, self._weighing(values.reshape(-1, 10)))
        if name == "friction" and values.min(initial=0.0) < 0:
            contact = system.contacts.names[int(values.argmin())]
            raise InvalidArgument(
                f"wrt: 'friction': noise takes that of {contact} to {values.min():.2g}; a smaller "
                "sigma is needed"
            )
        of = {"friction": system.contacts.friction, "restitution": system.contacts.restitution}
        contacts = system.contacts.with_coefficients(**{**of, name: values})
        return self._by(scheme, system.with_contacts(contacts))

    def _by(self, scheme: ContactScheme, system: System) -> Step:
        steps = ContactSteps(scheme, system, self._steps.dt)
        return lambda t, q, v: steps.step(t, q, v)[:2]

    def _weighing(self, inertias: Array) -> System:
        """Return the system of the same robot with other inertias (bodies, 10)."""
        scene, system = self._steps.scene, self._steps.system
        heavy = replace(scene, robot=weighing(scene.robot, inertias))
        return System(
            Workspace(heavy.bilateral), system.applied, passive=system.passive,
            contacts=heavy.contact_bounds,
        )  # fmt: skip


def _values(steps: LinearizedStep, parameter: str) -> Array:
    """Return the numbers of a parameter (k,)."""
    if parameter == "solref":
        return np.array(steps.scheme.solref)  # type: ignore[attr-defined]
    if parameter == "inertias":
        bodies = list(steps.scene.robot.unedited.inertias)[1:]
        return np.concatenate([body.toDynamicParameters() for body in bodies])
    return np.array(getattr(steps.system.contacts, parameter))


def _weights(inertias: Array) -> Array:
    """Return the sizes of the inertias (bodies, 10), side by side."""
    mass, trace = inertias[:, 0], inertias[:, [4, 6, 9]].sum(axis=1)
    mass, trace = (np.where(x > 0, x, x[x > 0].min(initial=1.0)) for x in (mass, trace))
    first = np.sqrt(mass * trace)
    return np.column_stack([mass, *3 * [first], *6 * [trace]]).ravel()
