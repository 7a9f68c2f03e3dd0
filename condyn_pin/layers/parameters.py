"""Parameters: what a scene is made of, as arrays that a layer is a function of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.layers.layer_map import Shape
from condyn_pin.model.smaller import weighing
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.routes.base import Route, check_parameters, linear_steps
from condyn_pin.simulation.routes.linear_steps import LinearSteps
from condyn_pin.simulation.routes.step_derivatives import Columns


class Made(NamedTuple):
    """A scene with its parameters, and how its steps are taken."""

    scene: Scene
    scheme: ContactScheme  # as asked for; steps are those of ``route.scheme(scheme)``
    route: Route


class Parameters:
    """Some of the parameters of a scene, by name.

    Attributes
    ----------
    made : Made
        The scene as it was given, with its own parameters.
    shapes : dict of str to shape
        Of friction and restitution one number for each `FrictionalContact`, of solref two, and of
        inertias ten for each joint.
    """

    def __init__(self, made: Made, names: Sequence[str]) -> None:
        self.made = self._last = made
        self._values: tuple[bytes, ...] = ()
        self._contacts = [
            i for i, c in enumerate(made.scene.contacts) if isinstance(c, FrictionalContact)
        ]
        self._owners = _owners(made.scene, self._contacts)
        k, bodies = len(self._contacts), made.scene.robot.model.njoints - 1
        known: dict[str, Shape] = {
            "friction": (k,), "restitution": (k,), "solref": (2,), "inertias": (bodies, 10),
        }  # fmt: skip
        names = check_parameters(made.route, made.scheme, names)
        if len(set(names)) < len(names):
            raise InvalidArgument(f"wrt = {list(names)}: each name once")
        self.shapes = {name: known[name] for name in names}

    def steps(self, values: Sequence[Array], dt: float) -> tuple[LinearSteps, Route]:
        """Return the steps of the scene with these values, and their route."""
        key = tuple(each.tobytes() for each in values)
        if key != self._values:
            self._last, self._values = self._with(values), key
        scene, scheme, route = self._last
        return linear_steps(scene, route.scheme(scheme), dt, tuple(self.shapes)), route

    def of(self, rows: Array, columns: Columns) -> list[Array]:
        """Return what rows (k, columns) have for each parameter (k, numbers)."""
        found = []
        for name in self.shapes:
            block = rows[..., columns.of(name)]
            found.append(block @ self._owners if name in ("friction", "restitution") else block)
        return found

    def _with(self, values: Sequence[Array]) -> Made:
        scene, scheme, route = self.made
        contacts = list(scene.contacts)
        for name, value in zip(self.shapes, values, strict=True):
            if name in ("friction", "restitution"):
                for i, x in zip(self._contacts, value.tolist(), strict=True):
                    contacts[i] = replace(contacts[i], **{name: x})
            elif name == "solref":
                solref: Any = {"solref": tuple(value.tolist())}
                if hasattr(scheme, "solref"):
                    scheme = replace(scheme, **solref)
                else:
                    route = replace(route, **solref)
            else:
                scene = replace(scene, robot=weighing(scene.robot, value))
        return Made(replace(scene, contacts=tuple(contacts)), scheme, route)


def _owners(scene: Scene, contacts: Sequence[int]) -> Array:
    """Return 1 where a cone is of a contact (cones, contacts)."""
    bounds = scene.contact_bounds
    of_cones = [i for i in contacts for _ in bounds[i].touches]
    of_cones += [i for i in contacts for pair in bounds[i].pairs for _ in range(pair.points)]
    owners = np.zeros((len(of_cones), len(contacts)))
    for cone, i in enumerate(of_cones):
        owners[cone, contacts.index(i)] = 1.0
    return owners
