"""The time loop: how far one has to turn pages to follow a step, and the names it had before."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.simulation import stability, walls

HOME = str(Path(cp.__file__).parent)
DT = 1e-3  # [s]

# Changes of file in a step of RungeKutta4 with PostStabilization whose sample is kept: four solves
# that go to the solver's file and back, the integrator, the correction, and the sample's forces.
MOST = 14

# More of them where bodies float: each stage begins and ends on the manifold.
OF_THE_MANIFOLD = 4


def files_of(scene: cp.Scene, steps: int) -> list[str]:
    """Return the file of each function of the package that a run of so many steps calls."""
    files, (q, v) = [], scene.state()

    def look(frame, event, _):
        if event == "call" and frame.f_code.co_filename.startswith(HOME):
            files.append(frame.f_code.co_filename)

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        cp.simulate(
            scene, q, v, duration=steps * DT, dt=DT, integrator=cp.RungeKutta4(),
            drift=cp.simulation.PostStabilization(),
        )  # fmt: skip
    finally:
        sys.setprofile(before)
    return files


def changes(files: list[str]) -> int:
    return sum(one != other for one, other in pairwise(files))


@pytest.mark.parametrize("name", ["four_bar", "cassie"])
def test_a_step_goes_through_few_files(name):
    made = cp.model.four_bar() if name == "four_bar" else robot(name)
    scene = cp.Scene(made, made.loops)
    files_of(scene, 1)  # what is imported and measured once
    floats = made.model.joints[1].shortname() == "JointModelFreeFlyer"
    most = MOST + floats * OF_THE_MANIFOLD
    found = changes(files_of(scene, 8)) - changes(files_of(scene, 7))
    assert 0 < found <= most, (
        f"a step of {name} changes file {found} times, at most {most} may be: keep what every step "
        "calls in one module, simulation/system.py above all"
    )


def test_names_of_the_last_version_warn():
    with pytest.warns(DeprecationWarning, match="Snapshot"):
        assert cp.Moment is cp.simulation.Snapshot
    for old, now in (("wall", "stability_limit"), ("growth", "growth")):
        with pytest.warns(DeprecationWarning, match=rf"stability\.{now}"):
            assert getattr(walls, old) is getattr(stability, now)
    with pytest.raises(AttributeError):
        walls.ceiling  # noqa: B018


def test_next_acceleration_is_acceleration():
    made = cp.model.four_bar()
    scene = cp.Scene(made, made.loops)
    workspace, (q, v) = cp.Workspace(scene), scene.state()
    tau = 0.1 * v
    with pytest.warns(DeprecationWarning, match=r"Workspace\.acceleration"):
        found = workspace.next_acceleration(q, v, tau)
    assert (found == workspace.acceleration(q, v, tau)).all()
