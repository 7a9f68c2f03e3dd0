"""A Scene and a Solution as a notebook shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from condyn_pin._core import show

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.dynamics.solution import Solution


def scene_html(scene: Scene) -> str:
    """Return what is in a scene; what it takes to find out is for `Scene.summary`."""
    robot = scene.robot
    rows = [(each.name, each.title, str(each.rows)) for each in scene.constraints]
    touching = [(each.name, type(each).__name__) for each in scene.contacts]
    said = {
        "robot": f"{robot.name}: nq {robot.nq}, nv {robot.nv}, {robot.mass:.6g} kg",
        "constraints": f"{len(rows)}, with {scene.rows} rows",
        "contacts": f"{len(touching)} that may open and slide",
    }
    return show.page(
        f"Scene of {robot.name}",
        show.facts(said.items()),
        show.folded(
            "constraints", show.grid(("constraint", "kind", "rows"), rows), count=len(rows)
        ),
        show.folded("contacts", show.grid(("contact", "kind"), touching), count=len(touching)),
        '<div style="opacity:0.7">scene.summary() has rank, redundant rows and mobility</div>',
    )


def solution_html(solution: Solution) -> str:
    """Return status, errors, forces and notices of an answer."""
    state, status = solution.state_error, solution.status
    said = {
        "dynamics error": f"{solution.dynamics_error:.1e} N, N m",
        "constraint error": f"{solution.constraint_error:.1e} m/s², rad/s²",
        "state error": f"{state.position:.1e} m, rad; {state.velocity:.1e} m/s, rad/s",
        "error bound of a": f"{solution.error_bound:.1e} (relative)",
        "took": f"{1e6 * solution.solve_time:.1f} µs, {solution.iterations} iterations",
    }
    forces = [
        (name, force.on, force.by, *_six([f"{x:.4f}" for x in force.components]))
        for name, force in solution.forces.items()
    ]
    headings = ("constraint", "on", "by", "fx", "fy", "fz", "mx", "my", "mz")
    return show.page(
        f"{solution.scene.robot.name}: {status.name.lower()}",
        "" if status.ok else show.notes([status.value]),
        show.facts(said.items()),
        show.folded(
            "forces on the first-named body, in the axes of each constraint [N, N m]",
            show.grid(headings, forces),
            count=len(forces),
        ),
        show.notes(solution.notices),
        ok=status.ok,
    )


def _six(numbers: list[str]) -> list[str]:
    """Return three or six components as six cells; of a coupling or a rod there is one."""
    return numbers + [""] * (6 - len(numbers))
