"""The forces of a batch: some the same for all states, some with a row a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from condyn_pin._core.parallel.memory import Arrays
from condyn_pin.constraints.applied_force import AppliedForce, applied_forces
from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class RowForces:
    """Forces as they travel with a kernel; rows travel as inputs, by their names.

    Attributes
    ----------
    forces : tuple of AppliedForce
        Those of the first state.
    rows : tuple of (int, str)
        Which of them have a row a state, and the name of the input that has it.
    """

    forces: tuple[AppliedForce, ...] = ()
    rows: tuple[tuple[int, str], ...] = ()

    def at(self, inputs: Arrays, i: int) -> tuple[AppliedForce, ...]:
        """Return the forces at state i of some inputs."""
        if not self.rows:
            return self.forces
        found = list(self.forces)
        for k, name in self.rows:
            found[k] = AppliedForce(found[k].frame, inputs[name][i], found[k].frame_of)
        return tuple(found)


def split(
    robot: Robot, forces: Sequence[AppliedForce], count: int, *, functions: bool = False
) -> tuple[tuple[AppliedForce, ...], RowForces, Arrays]:
    """Return the forces of a batch checked, as a kernel has them, and their inputs."""
    checked = applied_forces(forces, functions=functions, rows=count)
    for force in checked:
        robot.frame(force.frame)  # what is no frame is refused before the work
    some = tuple((k, f"force{k}") for k, force in enumerate(checked) if force.has_rows)
    inputs = {name: checked[k].numbers for k, name in some}
    first = tuple(force.row(0) for force in checked) if count else ()
    return checked, RowForces(first, some), inputs
