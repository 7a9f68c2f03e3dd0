"""ContactSolution: impulses that carry their own proof."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.show import Outcome
from condyn_pin.contact.indeterminacy import Indeterminacy, is_determined
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import ContactResiduals, contact_residuals, infeasible_contacts

# Why an answer is not ok, and its cure; a status names all cures, an error those not tried.
_INACCURATE: Final = (
    "the impulses do not meet the law of the problem to the accuracy asked for, or momentum or "
    "loops, where the notices of a step report it"
)
_NOT_FINITE: Final = "the impulses are not finite although the problem is: its numbers overflow"
_NEWTON: Final = "solve with SemismoothNewton()"
_STOPPED: Final = (
    "the budget of other attempts ended before one of them met the law of the problem to the "
    "accuracy asked for"
)
_POLYGON: Final = (
    "a polygon in place of the cone, Lemke(), never meets a sliding contact closer than its sides "
    "are to the circle"
)
_LOCKED: Final = (
    "friction that locks bodies, as in Painleve's rod, may need Lemke(), or a smaller step"
)


class ContactStatus(Outcome):
    """Outcome of a contact solve; the value is advice."""

    OK = "the impulses meet the law of the problem to the accuracy asked for"
    INACCURATE = f"{_INACCURATE}: allow more iterations, or {_NEWTON}; {_POLYGON}; {_LOCKED}"
    INFEASIBLE = (
        "no impulse can keep the contacts apart, as they are asked to: they press on what cannot "
        "move; look at bodies that are fixed, at the gaps of contacts between them, and at the "
        "velocities that the scheme prescribes"
    )
    NOT_FINITE = f"{_NOT_FINITE}; {_NEWTON}, or in other units"
    OUT_OF_BUDGET = f"{_STOPPED}: raise it, ADMM(budget=1000); {_LOCKED}"

    def text(self, tried: str, more: str = "") -> str:
        """Name and cause, and cures but for the solver that was `tried`; `more` is one of them."""
        newton = "" if tried == "SemismoothNewton" else _NEWTON
        if self is ContactStatus.INACCURATE:
            why = _POLYGON if tried == "Lemke" else _LOCKED
            return self.text_of(_INACCURATE, "allow more iterations", newton, more, why)
        if self is ContactStatus.NOT_FINITE:
            return self.text_of(_NOT_FINITE, newton, "use other units")
        if self is ContactStatus.OUT_OF_BUDGET:
            return self.text_of(_STOPPED, f"raise it, {tried}(budget=1000)", more, _LOCKED)
        return str(self)


@dataclass(frozen=True, eq=False, repr=False)
class ContactSolution:
    """Impulses and velocities of contacts, with residuals recomputed.

    sigma = G lam + g + R lam

    Attributes
    ----------
    lam : (m,) array
        Impulses on the robot, all rows, in the axes of each contact [N s].
    sigma : (m,) array
        Velocities of the contacts after the step [m/s].
    natural : float
        |lam - P_K(lam - d)|, or |sigma| of what sticks, in units of the problem [1]: zero if and
        only if it is solved.
    status : ContactStatus
        OK if `natural` is within the accuracy that was asked for.
    iterations : int
        Of all methods that were tried.
    path : tuple of str
        The methods that were tried; the last one found the answer.
    solve_time : float
        Time of the solve without the proof [s].
    problem : ContactProblem
        What was solved.
    unmet : tuple of str
        Contacts that no impulse can meet together, if the status is infeasible.
    several : tuple of Indeterminacy
        Contacts whose velocities Coulomb's law does not determine: `lam` is then chosen by the rule
        of equally compliant contacts, in the limit of rigid ones.
    """

    lam: Array  # [N s]
    sigma: Array  # [m/s]
    natural: float
    status: ContactStatus
    iterations: int
    path: tuple[str, ...]
    solve_time: float  # [s]
    problem: ContactProblem
    unmet: tuple[str, ...] = ()
    several: tuple[Indeterminacy, ...] = ()

    @cached_property
    def residuals(self) -> ContactResiduals:
        """Residual of each condition, whatever the solver was; computed when read."""
        with np.errstate(all="ignore"):  # of impulses that are not finite
            return contact_residuals(self.problem, self.lam)

    @cached_property
    def unique_motion(self) -> bool | None:
        """True if sigma is the only one that obeys the law; None where that is not decided.

        False: `several` says which contacts leave it open. True where the problem is convex, and
        where each contact with friction is alone and has G_nn > mu |G_nt|. Contacts with friction
        that feel each other have one motion most often, and no cheap proof of it.
        """
        return False if self.several else True if is_determined(self.problem) else None

    @property
    def could_hold(self) -> tuple[str, ...]:
        """Contacts that could hold what they touch by friction, although one of them moves."""
        wedges = (each for each in self.several if each.kind == "wedge")
        return tuple(name for each in wedges for name in each.names)

    @cached_property
    def unique_forces(self) -> bool:
        """True if lam is the only answer: G + R has full rank, but for rows that nothing moves.

        Where it has not, as on four corners of a box, contacts share a load in many ways that move
        nothing: compare J^T lam, and not lam. A row of friction that nothing moves, as that out of
        the plane of a plane mechanism, has no force.
        """
        problem = self.problem
        G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
        size = np.sqrt(G.diagonal())
        n = problem.sets.normals
        if not size[n].all() or not size[problem.sets.parts[2]].all():
            return False
        moved = np.flatnonzero(size)
        scaled = G[moved[:, None], moved] / np.outer(size[moved], size[moved])
        eigenvalues = np.linalg.eigvalsh(scaled)
        return not len(moved) or bool(eigenvalues[0] > tolerances.CONTACT_RANK * eigenvalues[-1])

    @property
    def forces(self) -> dict[str, Array]:
        """Impulses by contact [N s]: (t1, t2, n) of a cone, one number of a stop or of friction."""
        blocks = self.problem.sets.blocks
        return {name: self.lam[blocks == i] for i, name in enumerate(self.problem.names)}

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices, a sentence each."""
        said = []
        if self.unmet:
            said.append(f"no impulse can meet {', '.join(self.unmet)}")
        if self._locked:
            said.append(
                f"friction locks {', '.join(self._locked)}: they carry any load among themselves, "
                "and Coulomb's law need not have an answer; with less friction it has"
            )
        said += [each.text for each in self.several]
        if self.status.ok and not self.several and not self.unique_forces:
            said.append(
                "the contacts are redundant: lam is one of many"
                + ("; the motion is the same" if self.unique_motion else "")
            )
        return tuple(said)

    @cached_property
    def _locked(self) -> tuple[str, ...]:
        """Contacts that a ccp has no answer for, where an ncp was not answered."""
        missed = ContactStatus.INACCURATE, ContactStatus.OUT_OF_BUDGET
        if self.status not in missed or self.problem.law != "ncp":
            return ()
        with np.errstate(all="ignore"):
            return infeasible_contacts(self.problem.replaced(law="ccp"))

    def __repr__(self) -> str:
        return (
            f"ContactSolution({len(self.problem.names)} contacts: {self.status.word}, "
            f"natural residual {self.natural:.1e})"
        )

    def __str__(self) -> str:
        impulses = self.problem.level == "impulse"
        lines = [
            f"{self.status.word} in {1e6 * self.solve_time:.1f} us, "
            f"{self.iterations} iterations of {', '.join(self.path) or 'nothing'}",
            *(f"{name:<16} {size:.1e}" for name, size in self.residuals._asdict().items()),
            f"{'impulses' if impulses else 'forces'} on the robot, axes of each contact "
            f"[{'N s' if impulses else 'N'}]:",
        ]
        for name, force in self.forces.items():
            lines.append(f"{name:<28} {np.array2string(force, precision=4, suppress_small=True)}")
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


# Redundant contacts with prescribed velocities that no rigid body can have.
#
# Where impulses z do nothing, G z = 0, they see nothing either: z . sigma = z . g, whatever lam is.
# A scheme that closes the gaps of two points of one body in the same step makes them approach
# each other by gap^2 / (L dt), which a rigid body does not. They would have to slide by that, under
# inner forces that grow up to friction; no solver finds them where it is 1e-8 of the other
# velocities.


# What is left out of g, relative to |g|, at most: a creep of a micrometre where a metre is moved.
_SMALL: Final = 1e-6

# What is left in, relative to |g|: no residual feels it.
_FELT: Final = 0.01 * tolerances.CONTACT_SOLVED


def drop_inconsistent_rows(problem: ContactProblem, lam: Array) -> ContactProblem | None:
    """Return the problem without the part of g that no motion of what touches has.

    g_A - Z Z^T g_A,    Z an orthonormal basis of G_AA z = 0

    with A the rows along which nothing moves: the normals of contacts that press, and all of those
    that stick.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    lam : (m,) array
        The best impulses that were found: they say which contacts press and stick.

    Returns
    -------
    ContactProblem or None
        None if there is no such part, or it is not small beside g.

    Notes
    -----
    Cost O(m^3).
    """
    stiff, speed = problem.scale
    sigma, cones = problem.velocities(lam), 3 * len(problem.friction)
    L, S = lam[:cones].reshape(-1, 3), sigma[:cones].reshape(-1, 3)
    presses = L[:, 2] * stiff > np.abs(S[:, 2])
    sticks = presses & (np.hypot(S[:, 0], S[:, 1]) <= _SMALL * speed)
    A = np.flatnonzero(np.column_stack((sticks, sticks, presses)))
    if problem.R is not None or not len(A):
        return None
    values, vectors = np.linalg.eigh(problem.G[np.ix_(A, A)])
    Z = vectors[:, values <= tolerances.CONTACT_RANK * values[-1]]
    out = Z.dot(Z.T.dot(problem.g[A]))
    if not _FELT * speed < np.abs(out).max() <= _SMALL * speed:
        return None
    g = problem.g.copy()
    g[A] -= out
    return problem.replaced(g=g)
