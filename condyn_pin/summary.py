"""Summary: a scene in one screen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from condyn_pin.scene import Scene

_ROWS_SHOWN = 12
_ILL_CONDITIONED = 1e12


@dataclass(frozen=True)
class Summary:
    """What a scene contains, what it asks for twice, and what it leaves out.

    Attributes
    ----------
    robot : str
    nq, nv : int
    mass : float
        [kg]
    constraints : tuple of (name, kind, rows)
    rows, rank, mobility : int
        m; independent rows; nv - rank, the degrees of freedom left.
    redundant : tuple of str
        Rows that can go without changing the motion.
    singular_values : tuple of float
        Smallest and largest nonzero one of the constraint Jacobian in the metric of M.
    condition : float
        Condition number of the mass matrix.
    notes : tuple of str
        What deserves attention.
    unused : tuple of str
        What the description has and the dynamics do not use.
    source, licence : str
    """

    robot: str
    nq: int
    nv: int
    mass: float  # [kg]
    constraints: tuple[tuple[str, str, int], ...]
    rows: int
    rank: int
    mobility: int
    redundant: tuple[str, ...]
    singular_values: tuple[float, float]
    condition: float
    notes: tuple[str, ...]
    unused: tuple[str, ...]
    source: str
    licence: str

    def facts(self) -> dict[str, str]:
        """Return the summary as label and text, for printing."""
        redundant = ", ".join(self.redundant[:_ROWS_SHOWN]) or "none"
        if len(self.redundant) > _ROWS_SHOWN:
            redundant += f", and {len(self.redundant) - _ROWS_SHOWN} more"
        facts = {
            "robot": f"{self.robot}: nq {self.nq}, nv {self.nv}, {self.mass:.6g} kg",
            "rows": f"{self.rows}, rank {self.rank}, mobility {self.mobility}",
            "redundant rows": redundant,
            "singular values": "{:.3g} ... {:.3g} 1/sqrt(kg)".format(*self.singular_values),
            "condition of M": f"{self.condition:.1e}",
            "source": self.source or "unknown",
            "licence": self.licence or "unknown",
        }
        return {
            label: text for label, text in facts.items() if self.rows or "singular" not in label
        }

    def __str__(self) -> str:
        lines = [f"{label:<16} {text}" for label, text in self.facts().items()]
        lines += [
            f"{'constraint':<16} {n}: {kind}, {rows} rows" for n, kind, rows in self.constraints
        ]
        lines += [f"{'not used':<16} {text}" for text in self.unused]
        lines += [f"{'note':<16} {text}" for text in self.notes]
        return "\n".join(lines)


def summarise(scene: Scene) -> Summary:
    """Return the summary of a scene."""
    robot, audit = scene.robot, scene.audit
    S = audit.singular_values
    unused = list(robot.unused)
    if robot.springs:
        joints = ", ".join(spring.joint for spring in robot.springs)
        unused.append(f"springs ({joints}): add Robot.passive_torque to tau")
    left_out = [loop.name for loop in robot.loops if loop not in scene.constraints]
    if left_out:
        unused.append(f"loops that are not in this scene ({', '.join(left_out)})")
    return Summary(
        robot=robot.name,
        nq=robot.nq,
        nv=robot.nv,
        mass=robot.mass,
        constraints=tuple((c.name, _kind(c), c.rows) for c in scene.constraints),
        rows=scene.rows,
        rank=audit.rank,
        mobility=audit.mobility,
        redundant=audit.redundant,
        singular_values=(float(S[audit.rank - 1]), float(S[0])) if audit.rank else (0.0, 0.0),
        condition=audit.condition,
        notes=tuple(_notes(scene)),
        unused=tuple(unused),
        source=robot.source,
        licence=robot.licence,
    )


def _kind(constraint: object) -> str:
    kind = getattr(constraint, "kind", None)
    name = type(constraint).__name__
    return f"{name} ({kind})" if kind else name


def _notes(scene: Scene) -> list[str]:
    audit = scene.audit
    notes = []
    if not audit.closed:
        notes.append("the loops cannot be closed from the first posture: figures are of it, open")
    if audit.condition > _ILL_CONDITIONED:
        notes.append(
            f"M has a condition number of {audit.condition:.0e}: look for bodies of next to no "
            "inertia; no method can be accurate on them"
        )
    if audit.mobility == 0:
        notes.append("mobility 0: nothing can move; a weld in place of a hinge does this")
    if audit.redundant:
        notes.append(
            f"{len(audit.redundant)} redundant rows: a is unique, lam is the smallest of many; "
            "DenseKKT needs mu > 0"
        )
    return notes
