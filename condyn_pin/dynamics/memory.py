"""Memory: what a scene needs to be solved again and again."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.threads import OneThread, alone
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.forces import Loads
from condyn_pin.constraints.rows.bound import AnyBound, Terms, finite_terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.nominal import NominalAnalysis, at_any_time, pinocchio_constraints_of
from condyn_pin.dynamics.raw import ConstraintDatas, ConstraintModels, raw_constraints
from condyn_pin.dynamics.scene import Scene

if TYPE_CHECKING:
    from condyn_pin.dynamics.derivatives.linearised import Linearisation


class Memory(OneThread):
    """What depends on the constraints of one scene; all that costs much is made on demand.

    Dense methods do without Pinocchio's memory of the constraints, and in long chains it takes all
    the memory there is.
    """

    def __init__(self, scene: Scene, drift: Baumgarte | None) -> None:
        scene.robot.check_unedited()
        self.model, self.drift = pin.Model(scene.robot.model), drift
        self._arguments = scene.robot.arguments

    def analysed(self, scene: Scene) -> Equations | None:
        """Analyse a scene, unless it was; return the equations made for that, to be used again."""
        if "nominal" in vars(scene) or at_any_time(scene) is not scene:
            return None
        equations = Equations(self.model, scene.bounds)
        vars(scene)["nominal"] = NominalAnalysis(scene, equations)
        equations.drift = self.drift
        return equations

    def hold(self, scene: Scene, equations: Equations | None) -> None:
        """Take another scene of the same model; nothing of the old one is left."""
        self.scene = scene
        self.check_unedited = scene.robot.check_unedited
        self.bounds: tuple[AnyBound, ...] = scene.bounds
        self.pinocchio_constraints = pinocchio_constraints_of(scene)
        self.proximal_settings: Any = None
        for made_on_demand in ("_made", "equations", "linearisation", "loads", "compiled"):
            self.__dict__.pop(made_on_demand, None)
        if equations is not None:
            self.equations = self._told(equations)

    @property
    def data(self) -> Any:
        """Pinocchio's memory, sized for the constraints of the scene."""
        return self._raw[0]

    @property
    def constraint_models(self) -> ConstraintModels:
        """The constraints as Pinocchio takes them."""
        return self._raw[1]

    @property
    def constraint_datas(self) -> ConstraintDatas:
        """Pinocchio's memory of each constraint."""
        return self._raw[2]

    @property
    def _raw(self) -> tuple[Any, ConstraintModels, ConstraintDatas]:
        self.check_alone()
        return self._made

    @cached_property
    def _made(self) -> tuple[Any, ConstraintModels, ConstraintDatas]:
        models, datas = raw_constraints(
            self.model, self.pinocchio_constraints.constraints, self.drift
        )
        _pin.init_constraint_dynamics(self.model, self._data, models, datas)
        return self._data, models, datas

    @cached_property
    def _data(self) -> Any:
        return whole_data(self.model)

    def scene_forces(self, lam: Array) -> Array:
        """Return the scene's forces from those of Pinocchio's constraints."""
        to_scene = self.pinocchio_constraints.to_scene
        return lam if to_scene is None else to_scene.dot(lam)

    def pinocchio_velocity(self, s: Array) -> Array:
        """Return the velocities of Pinocchio's constraints for those of the scene's, s (m,)."""
        to_scene = self.pinocchio_constraints.to_scene  # lam goes the other way
        return s if to_scene is None else to_scene.T.dot(s)

    @cached_property
    def equations(self) -> Equations:
        """The equations of the scene, in memory of their own that no solver writes to."""
        return self._told(Equations(self.model, self.bounds, self.drift))

    def _told(self, equations: Equations) -> Equations:
        """Equations that know the redundancy of the scene's rows, if any look independent."""
        nominal = self.scene.nominal
        equations.redundancy = (lambda: nominal.redundancy) if nominal.looks_independent else None
        equations.digits = (lambda: nominal.rounded_file) if nominal.rounded_file else None
        return equations

    @cached_property
    def linearisation(self) -> Linearisation:
        """The linearised equations, in memory of their own but for the constraint forces."""
        # imported here: a solve needs none of it
        from condyn_pin.dynamics.derivatives.linearised import Linearisation

        return Linearisation(self.model, self.bounds, self.drift, self.equations)

    @cached_property
    def linearised_gaps(self) -> Linearisation:
        """J a + gamma + c, linearised: at rest, with a = 0, how the gaps change."""
        from condyn_pin.dynamics.derivatives.linearised import Linearisation

        return Linearisation(self.model, self.bounds, Baumgarte(0.0, 1.0))

    @cached_property
    def loads(self) -> Loads:
        """Forces on frames, evaluated in the memory of the equations."""
        return Loads(self.scene.robot, self.model, self.equations.data)

    @alone
    def terms(self, q: ArrayLike, v: ArrayLike) -> Terms:
        """Return M, h, J, gamma and a_ref at a state."""
        self.check_unedited()
        q_, v_, _ = self._arguments.check(q, v, np.zeros(self.model.nv))
        return finite_terms(self.equations, q_, v_)

    @alone
    def jacobian(self, q: ArrayLike) -> Array:
        """Return the constraint Jacobian J (m, nv)."""
        return self.equations.jacobian(self._configuration(q))

    @alone
    def violation(self, q: ArrayLike) -> Array:
        """Return c(q) (m,) [m, rad]."""
        return self.equations.violation(self._configuration(q))

    def _configuration(self, q: ArrayLike) -> Array:
        self.check_unedited()
        still = np.zeros(self.model.nv)
        return self._arguments.check(q, still, still)[0]
