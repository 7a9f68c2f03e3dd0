"""Force distributions: which of many contact forces and torques to choose, and how to write one.

Where motors work against each other through contacts and loops, a motion leaves internal forces
free,

    (u, lam) = (u_0, lam_0) + N w,    B u + J^T lam the same for every w,

and a criterion chooses among those that keep all contacts in their cones:

    min_w  |S (u, lam)|^2    with    A lam + t <= 0.

1. Add one file to this folder with one frozen dataclass that inherits from `ForceDistribution`. It
   registers itself in `DISTRIBUTIONS`.
2. Write `measured(at, motors)`, which returns S (r, k + m): torques first, then all rows of the
   scene. What S leaves open is decided by the smallest forces.
3. `margin(A, y, N)` returns t, zero by default [N].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import check_type, register
from condyn_pin._core.arrays import Array
from condyn_pin.contact.cones import Cones
from condyn_pin.control.cones import placements, pyramids
from condyn_pin.control.qp.chain import ChainAnswer, SolverLadder
from condyn_pin.control.qp.qp_solver import QPSolver, QuadraticProgram
from condyn_pin.control.qp.solvers import ProxQP
from condyn_pin.dynamics.solution import Sites, upward
from condyn_pin.errors import Infeasible

DISTRIBUTIONS: dict[str, type[ForceDistribution]] = {}

# Beside the criterion: the squares of all torques and forces, which decide what it leaves open.
_SMALLEST = 1e-6


@dataclass(frozen=True)
class ForceDistribution(ABC):
    """A criterion that chooses among contact forces; the base of all of them.

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name: forces stay within them.
    qp : QPSolver
        Solver of the quadratic program.

    Raises
    ------
    InvalidArgument
        If `qp` is no solver of quadratic programs.
    """

    title: ClassVar[str]

    cones: Cones
    qp: QPSolver = field(default_factory=ProxQP, kw_only=True)

    def __post_init__(self) -> None:
        check_type("qp", self.qp, QPSolver, "a solver such as ProxQP() is needed")

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if getattr(cls.measured, "__isabstractmethod__", False):
            return
        register(DISTRIBUTIONS, cls.__name__, cls, f"a force distribution named {cls.__name__}")

    @abstractmethod
    def measured(self, at: Sites, motors: int) -> Array:
        """Return S (r, motors + m), of which |S (u, lam)| is to be small, `at` a configuration."""

    def margin(self, A: Array, y: Array, N: Array) -> float:
        """Return t [N] of A (y + N w) + t <= 0, y and N the rows of lam."""
        return 0.0

    def share(self, at: Sites, u: Array, lam: Array, N: Array) -> tuple[Array, Array]:
        """Return the u and lam of all u + N_u w, lam + N_lam w that the criterion chooses.

        Parameters
        ----------
        at : Sites
            The scene and its configuration.
        u, lam : (k,), (m,) array
            Torques of the motors [N m, N], and constraint forces [N, N m].
        N : (k + m, d) array
            Basis of the internal forces, torques first.

        Raises
        ------
        Infeasible
            If no forces of this motion are within the cones; the text names the rows.
        """
        bound = pyramids(at.scene, self.cones)
        A = np.zeros((len(bound.names), len(lam)))
        A[:, bound.touching] = bound.rows(placements(at))
        mass = at.scene.robot.mass
        y, k = np.concatenate((u, lam)) / mass, len(u)
        C, upper = A @ N[k:], -(A @ y[k:])
        upper -= self.margin(A, lam, N[k:]) / mass
        S = self.measured(at, k)
        SN = S @ N
        H = SN.T @ SN + _SMALLEST * (N.T @ N)
        g = SN.T @ (S @ y) + _SMALLEST * (N.T @ y)
        none = np.zeros((0, N.shape[1]))
        program = QuadraticProgram(H, g, none, np.zeros(0), C, np.full(len(C), -np.inf), upper)
        answer = SolverLadder(self.qp).solve(program, lambda: (np.zeros(0), np.ones(len(C))))
        if not answer.solved or answer.answer is None:
            raise Infeasible(_missing_forces(answer, bound.names, mass))
        found = mass * (y + N @ answer.answer.x)
        return found[:k], found[k:]


def _missing_forces(answer: ChainAnswer, names: tuple[str, ...], mass: float) -> str:
    """Return the sentence on forces that do not exist."""
    if answer.elastic is None:
        return f"no solver found forces within the cones, of {', '.join(answer.path)}; try another"
    given = mass * answer.elastic.of_inequalities
    order = [i for i in np.argsort(-given).tolist() if given[i] > 0][:4]
    rows = ", ".join(f"{names[i]!r} by {given[i]:.4g} N" for i in order)
    return (
        f"the floor cannot give this motion: at least {rows} would have to give; lean the robot, "
        "move more slowly, or ask for another acceleration"
    )


@dataclass(frozen=True)
class LeastNorm(ForceDistribution):
    """The smallest forces within the cones, in the sum of squares of all rows [N, N m].

    min |lam|^2    with  A lam <= 0

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    """

    title: ClassVar[str] = "smallest forces"

    def measured(self, at: Sites, motors: int) -> Array:
        """Return the rows of all forces."""
        m = at.scene.rows
        return np.hstack((np.zeros((m, motors)), np.eye(m)))


@dataclass(frozen=True)
class LeastTorque(ForceDistribution):
    """The smallest torques of the motors with forces within the cones, in the sum of squares.

    min |u|^2    with  A lam <= 0

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    """

    title: ClassVar[str] = "smallest torques"

    def measured(self, at: Sites, motors: int) -> Array:
        """Return the rows of all torques."""
        return np.hstack((np.eye(motors), np.zeros((motors, at.scene.rows))))


# How much of the largest margin the smallest forces may use up.
_GIVEN = 1e-6


@dataclass(frozen=True)
class LargestMargin(LeastNorm):
    """The forces with the largest smallest margin to their cones, and of these the smallest.

    max t    with  A lam + t <= 0

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    """

    title: ClassVar[str] = "largest margin"

    def margin(self, A: Array, y: Array, N: Array) -> float:
        """Return the largest t that some forces have, by a linear program."""
        # imported here: scipy.optimize takes as long to import as Pinocchio
        from scipy.optimize import linprog

        size = max(float(np.abs(y).max(initial=0.0)), np.finfo(float).tiny)
        found = linprog(
            np.concatenate((np.zeros(N.shape[1]), [-1.0])),
            np.hstack((A @ N, np.ones((len(A), 1)))),
            -(A @ y) / size,
            bounds=(None, None),
            method="highs",
        )
        largest = size * float(found.x[-1]) if found.status == 0 else 0.0
        return largest - _GIVEN * size if largest > 0 else 0.0


@dataclass(frozen=True)
class CentredPressure(ForceDistribution):
    """Forces along the normals, with their centres of pressure in the middle of the contacts.

    It minimises the tangential forces of each contact, and its tipping moments divided by the
    larger half of its size. Points have no moments.

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.

    References
    ----------
    Righetti, Buchli, Mistry, Kalakrishnan, Schaal. Optimal distribution of contact forces with
    inverse-dynamics control. International Journal of Robotics Research, 2013.
    """

    title: ClassVar[str] = "centred pressure"

    def measured(self, at: Sites, motors: int) -> Array:
        """Return the rows of tangential forces, and of moments over lengths."""
        scene, up, rows = at.scene, upward(at.scene), []
        forces = at.forces(np.zeros(scene.rows))
        for contact, bound in zip(scene.constraints, scene.bounds, strict=True):
            if contact.support is None:
                continue
            R = forces[bound.name].own.rotation
            normal = R[:, 2] if contact.has_normal else up
            flat = np.eye(3) - np.outer(normal, normal)
            whole = np.array([bound.whole(row) for row in np.eye(bound.size)])
            block = np.zeros((whole.shape[1], motors + scene.rows))
            columns = slice(motors + bound.rows.start, motors + bound.rows.stop)
            block[:3, columns] = flat @ R @ whole[:, :3].T
            size = max(contact.support.half_length or 0.0, contact.support.half_width or 0.0)
            if size:
                block[3:, columns] = flat @ R @ whole[:, 3:].T / size
            rows.append(block)
        return np.vstack([np.zeros((0, motors + scene.rows)), *rows])
