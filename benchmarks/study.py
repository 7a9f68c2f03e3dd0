"""Curves that are known, measured again; a full study, timed; and what two processes bring.

    python benchmarks/study.py [--curves] [--full] [--processes]

All three by default. Curves are errors after one proximal iteration, which fall with mu; of a
parallelogram by the mass of its coupler, against its closed form; of Pinocchio's derivatives, as
the library calls them and as they are called without the settings of the solve; and of a motion.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter, process_time, sleep
from typing import ClassVar

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from script import Printed, processor_time

import condyn_pin as cp
import lab
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.model.mechanisms.machine import add_rod
from condyn_pin.simulation.drift import NoDrift
from condyn_pin.simulation.integrators.explicit import RungeKutta4
from condyn_pin.study.measures.measure import ComparedAnswer, relative

GRAVITY = 9.81  # [m/s^2]

# How crank, coupler and rocker of a parallelogram turn, and where it is looked at.
TOGETHER = np.array([1.0, -1.0, 1.0])
RAISED = np.pi / 2 + 0.9  # of the cranks, 0.9 beyond the vertical [rad]


def parallelogram(coupler: float) -> cp.Scene:
    """Return cranks of 1 kg and 1 m that carry a coupler of some mass [kg] and 1 m."""
    model = pin.Model()
    model.name = f"parallelogram {coupler:g}"
    crank = add_rod(model, "crank", 0, 0.0, 1.0, 1.0)
    add_rod(model, "coupler", crank, 1.0, 1.0, coupler)
    add_rod(model, "rocker", 0, 1.0, 1.0, 1.0)
    robot = cp.Robot(model.name, model, postures={"raised": RAISED * TOGETHER})
    return cp.Scene(robot, [cp.Loop("coupler_tip", "rocker_tip")])


@dataclass(frozen=True)
class ParallelogramMeasure(cp.study.AccelerationMeasure):
    """The error of the crank of `parallelogram`, relative to its closed form.

    (2/3 + s) theta'' = -g (1 + s) cos theta, for cranks of 1 kg and 1 m, and a coupler of s kg.
    """

    name: ClassVar[str] = "parallelogram"

    def truth(self, scene: cp.Scene, state: State) -> Array:
        """Return theta''."""
        s = scene.robot.model.inertias[scene.robot.model.getJointId("coupler")].mass
        return np.array([-GRAVITY * (1 + s) * np.cos(state[0][0]) / (2 / 3 + s)])

    def answer(
        self, workspace: Workspace, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer, judged by the crank alone."""
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        return ComparedAnswer.of(solution, relative(solution.a[:1], truth, 0.0), accuracy)


@dataclass(frozen=True)
class BareDerivativeMeasure(cp.study.DerivativeMeasure):
    """Pinocchio's derivatives with settings of their own: the protocol that is not kept.

    Fresh settings have not counted an iteration, and the derivative is then one of a damped system.
    """

    name: ClassVar[str] = "derivatives_fresh_settings"

    method: str = "pinocchio"

    def answer(
        self, workspace: Workspace, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of Pinocchio, copied."""
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        model, data = workspace.model, workspace.data
        models, datas = workspace.constraint_models, workspace.constraint_datas
        used = workspace.proximal_settings
        pin.constraintDynamics(model, data, *state, models, datas, used)
        fresh = pin.ProximalSettings(0.0, 0.0, used.mu, used.max_iter)
        parts = pin.computeConstraintDynamicsDerivatives(model, data, models, datas, fresh)
        pairs = zip(parts[:3], np.hsplit(truth, 3), strict=True)
        error = max(relative(found, true, 1.0) for found, true in pairs)
        return ComparedAnswer.of(solution, error, promised=np.inf)

    def calls(self, workspace: Workspace) -> Mapping[str, Call]:
        """Return nothing: it is wrong, and not worth a time."""
        return {}


def one_iteration(mus: list[float]) -> cp.study.Table:
    """Return the error of a on Talos after one proximal iteration."""
    talos = cp.load_robot("talos")
    solvers = cp.study.sweep(cp.Proximal(max_iterations=1), mu=mus)
    return cp.Study(cp.Scene(talos, talos.contacts), solvers, states=10).run(timed=False)


def mass_ratios(couplers: list[float]) -> cp.study.Table:
    """Return the error of a parallelogram after one proximal iteration at mu = 1e-8."""
    scenes = [parallelogram(s) for s in couplers]
    solvers = [cp.Proximal(mu=1e-8, max_iterations=1)]
    turning = cp.study.GivenStates("turning", [(RAISED * TOGETHER, -TOGETHER, np.zeros(3))])
    study = cp.Study(scenes, solvers, states=turning, measure=ParallelogramMeasure())
    return study.run(timed=False)


def protocols(mus: list[float]) -> cp.study.Table:
    """Return the error of Pinocchio's derivatives on Talos, with the protocol and without."""
    talos = cp.load_robot("talos")
    solvers = cp.study.sweep(cp.Proximal(), mu=mus)
    measures = [cp.study.DerivativeMeasure("pinocchio"), BareDerivativeMeasure()]
    scene = cp.Scene(talos, talos.contacts)
    return cp.Study(scene, solvers, states=3, measure=measures).run(timed=False)


def bricard() -> cp.Scene:
    """Return Bricard's linkage, its last hinge held at its middle and 0.3 m from there.

    One iteration is off by less than 3.7 mu here: a state off the constraints keeps the independent
    rows, which mu does not damp.
    """
    robot, balls = cp.load_robot("bricard"), list[cp.Loop]()
    for name, along in (("middle", 0.5), ("beyond", 0.8)):  # from the near end of the hinge [m]
        robot = robot.with_frame(f"{name} a", "hinge_near_a", [0.0, 0.0, along])
        robot = robot.with_frame(f"{name} b", "hinge_near_b", [along, 0.0, 0.0])
        balls.append(cp.Loop(f"{name} a", f"{name} b", name=name))
    return cp.Scene(robot, balls)


@dataclass(frozen=True)
class BricardMeasure(cp.study.TrajectoryMeasure):
    """The error of the first hinge of `bricard` at the end [rad], by the closed form of A04."""

    name: ClassVar[str] = "bricard"

    def truth(self, scene: cp.Scene, state: State) -> Array:
        """Return its angle."""
        problem = lab.load_problem("A04")
        return np.array([problem.motion(self.duration)[0]])

    def answer(
        self, workspace: Workspace, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a motion, judged by the first hinge alone."""
        motion = self._motion(workspace, state)
        error, status = float(abs(motion.q[-1, 0] - truth[0])), motion.status
        gap = float(motion.violation.max())
        return ComparedAnswer(
            error, "ok" if status.ok else status.name.lower(), 0.0, gap, len(motion.t)
        )


# What is left of mu = 1e-2 after 200 iterations is below rounding.
CONVERGED = cp.Proximal(max_iterations=200, relative_accuracy=1e-14)


def motions(solvers: list[cp.dynamics.Solver]) -> cp.study.Table:
    """Return the error of Bricard's linkage after a second in steps of a millisecond."""
    measure = BricardMeasure(duration=1.0, integrator=RungeKutta4(), drift=NoDrift())
    states = cp.study.PostureStates(["home"])
    return cp.Study(bricard(), solvers, states=states, measure=measure).run(timed=False)


def show_curves() -> None:
    """Print the known curves."""
    print("Talos, one iteration: mu, median and worst error of a, over mu")
    for row in one_iteration([10.0**-k for k in range(2, 11)]).rows:
        mu = row.parameters["mu"]
        print(
            f"{mu:8.0e} {row.error_median:9.2e} {row.error_worst:9.2e} {row.error_worst / mu:7.2f}"
        )
    print("parallelogram, one iteration at mu = 1e-8: coupler [kg], error, over its mass")
    couplers = [10.0**k for k in range(7)]
    for s, row in zip(couplers, mass_ratios(couplers).rows, strict=True):
        print(f"{s:8.0e} {row.error_worst:9.2e} {row.error_worst / s:9.2e}")
    print("Talos, Pinocchio's derivatives: mu, error with the protocol, and without")
    mus = [10.0**-k for k in range(2, 13, 2)]
    rows = protocols(mus).rows
    for mu, kept, not_kept in zip(mus, rows[: len(mus)], rows[len(mus) :], strict=True):
        print(f"{mu:8.0e} {kept.error_worst:9.2e} {not_kept.error_worst:9.2e}")
    print(
        "Bricard, 1 s of Runge-Kutta 4 at 1 ms: mu, error of the first hinge [rad] after one "
        "iteration a solve, over mu, and converged"
    )
    mus = [10.0**-k for k in range(2, 11, 2)]
    once = cp.study.sweep(cp.Proximal(max_iterations=1), mu=mus)
    rows = motions([*once, *cp.study.sweep(CONVERGED, mu=mus)]).rows
    for mu, one, many in zip(mus, rows[: len(mus)], rows[len(mus) :], strict=True):
        once_in_mu = one.error_worst / mu
        print(f"{mu:8.0e} {one.error_worst:9.2e} {once_in_mu:7.2f} {many.error_worst:9.2e}")


def show_full() -> None:
    """Time a full study of Talos and Cassie."""
    start, work = perf_counter(), process_time()
    table = cp.Study(["talos", "cassie"]).run()
    passed, worked = perf_counter() - start, process_time() - work
    said = dict.fromkeys(row.timed for row in table.rows if row.median_us)
    print(
        f"full study of Talos and Cassie: {len(table.rows)} rows in {passed:.0f} s, of which "
        f"{worked:.0f} s of processor time; {'; '.join(said)}"
    )


def get_ready(_: int) -> None:
    """Import what a study needs, and give the other process time for it too."""
    cp.load_robot("talos")
    sleep(0.5)


def show_processes() -> None:
    """Compare the errors of a study here with those of two processes."""
    study = cp.Study(["talos", "cassie"])
    start, work = perf_counter(), process_time()
    alone = study.run(timed=False)
    serial, serial_work = perf_counter() - start, process_time() - work
    with cp.Processes(2) as executor:
        list(executor.map(get_ready, range(4)))
        start, work = perf_counter(), processor_time(executor.pids)
        together = study.run(timed=False, executor=executor)
        parallel, all_work = perf_counter() - start, processor_time(executor.pids) - work
    print(
        f"errors here {serial:.1f} s ({serial_work:.1f} s of processor time), in two processes "
        f"{parallel:.1f} s ({all_work:.1f} s in all): "
        f"{serial / parallel:.2f} times as fast, same rows: {alone.rows == together.rows}; "
        f"load {os.getloadavg()[0]:.1f}"
    )


PARTS = {"curves": show_curves, "full": show_full, "processes": show_processes}


def show(given: Namespace) -> None:
    """Print what is asked for."""
    wanted = [name for name in PARTS if getattr(given, name)] or list(PARTS)
    for name in wanted:
        PARTS[name]()


def _options(parser: ArgumentParser) -> None:
    for name in PARTS:
        parser.add_argument(f"--{name}", action="store_true")


SUBJECTS = [Printed("study", "known curves, a full study, two processes", show, _options)]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
