"""Constrained rigid-body dynamics on Pinocchio: solve it, prove it, and see what accuracy costs.

    M(q) a + h(q, v) = tau + J(q)^T lam,    J a + gamma = a_ref

Names are imported when they are first used, so that `condyn doctor` also works where Pinocchio
itself does not import.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from condyn_pin.audit import Audit as Audit
    from condyn_pin.batch.chunks import map_chunks as map_chunks
    from condyn_pin.batch.derivatives import BatchDerivatives as BatchDerivatives
    from condyn_pin.batch.processes import Processes as Processes
    from condyn_pin.batch.simulation import simulate_batch as simulate_batch
    from condyn_pin.batch.solution import BatchSolution as BatchSolution
    from condyn_pin.batch.trajectory import BatchTrajectory as BatchTrajectory
    from condyn_pin.batch.verbs import derivatives_batch as derivatives_batch
    from condyn_pin.batch.verbs import solve_batch as solve_batch
    from condyn_pin.bridge.cross_check import CrossCheck as CrossCheck
    from condyn_pin.bridge.cross_check import TermCheck as TermCheck
    from condyn_pin.bridge.mujoco_bridge import MujocoBridge as MujocoBridge
    from condyn_pin.constraints import Constraint as Constraint
    from condyn_pin.constraints import Coupling as Coupling
    from condyn_pin.constraints import Loop as Loop
    from condyn_pin.contacts import LineContact as LineContact
    from condyn_pin.contacts import PlanarContact as PlanarContact
    from condyn_pin.contacts import PointContact as PointContact
    from condyn_pin.contacts import SurfaceContact as SurfaceContact
    from condyn_pin.differentiation.base import Derivatives as Derivatives
    from condyn_pin.drift import DRIFTS as DRIFTS
    from condyn_pin.drift import Baumgarte as Baumgarte
    from condyn_pin.drift import Drift as Drift
    from condyn_pin.drift.no_drift import NoDrift as NoDrift
    from condyn_pin.drift.post_stabilization import PostStabilization as PostStabilization
    from condyn_pin.drift.projection import Projection as Projection
    from condyn_pin.errors import BranchChanged as BranchChanged
    from condyn_pin.errors import BrokenPinocchio as BrokenPinocchio
    from condyn_pin.errors import BrowserFailed as BrowserFailed
    from condyn_pin.errors import CondynError as CondynError
    from condyn_pin.errors import DerivativesDisagree as DerivativesDisagree
    from condyn_pin.errors import Interrupted as Interrupted
    from condyn_pin.errors import InvalidArgument as InvalidArgument
    from condyn_pin.errors import InvalidConstraint as InvalidConstraint
    from condyn_pin.errors import InvalidModel as InvalidModel
    from condyn_pin.errors import MissingExtra as MissingExtra
    from condyn_pin.errors import NotAssembled as NotAssembled
    from condyn_pin.errors import NotReached as NotReached
    from condyn_pin.errors import NotTuned as NotTuned
    from condyn_pin.errors import SolveFailed as SolveFailed
    from condyn_pin.errors import StaleModel as StaleModel
    from condyn_pin.errors import StepFailed as StepFailed
    from condyn_pin.errors import UnknownName as UnknownName
    from condyn_pin.errors import UnsupportedBackend as UnsupportedBackend
    from condyn_pin.errors import UnsupportedConstraint as UnsupportedConstraint
    from condyn_pin.errors import WorkersLost as WorkersLost
    from condyn_pin.extremes import EXTREMES as EXTREMES
    from condyn_pin.force import ConstraintForce as ConstraintForce
    from condyn_pin.impacts import Impact as Impact
    from condyn_pin.impacts import impact as impact
    from condyn_pin.ladders import LADDERS as LADDERS
    from condyn_pin.load import available_robots as available_robots
    from condyn_pin.load import load_robot as load_robot
    from condyn_pin.mechanisms.chain import chain as chain
    from condyn_pin.mechanisms.four_bar import four_bar as four_bar
    from condyn_pin.mechanisms.n_four_bar import n_four_bar as n_four_bar
    from condyn_pin.mechanisms.pendulum import pendulum as pendulum
    from condyn_pin.mechanisms.rolling_ball import rolling_ball as rolling_ball
    from condyn_pin.mechanisms.rolling_disc import rolling_disc as rolling_disc
    from condyn_pin.mechanisms.sleigh import sleigh as sleigh
    from condyn_pin.mechanisms.unicycle import unicycle as unicycle
    from condyn_pin.motors.actuation import Actuation as Actuation
    from condyn_pin.motors.inverse import InverseDynamics as InverseDynamics
    from condyn_pin.motors.inverse import gravity_compensation as gravity_compensation
    from condyn_pin.motors.inverse import inverse_dynamics as inverse_dynamics
    from condyn_pin.motors.operational import OperationalSpace as OperationalSpace
    from condyn_pin.motors.operational import operational_space as operational_space
    from condyn_pin.motors.transmissions import Transmission as Transmission
    from condyn_pin.motors.transmissions import transmission as transmission
    from condyn_pin.nonholonomic import Knife as Knife
    from condyn_pin.nonholonomic import RollingBall as RollingBall
    from condyn_pin.nonholonomic import RollingWheel as RollingWheel
    from condyn_pin.problems import PROBLEMS as PROBLEMS
    from condyn_pin.problems import Problem as Problem
    from condyn_pin.problems.loading import load_problem as load_problem
    from condyn_pin.problems.result import ProblemResult as ProblemResult
    from condyn_pin.proof import Proof as Proof
    from condyn_pin.robot import Robot as Robot
    from condyn_pin.rows.terms import Terms as Terms
    from condyn_pin.scene import Scene as Scene
    from condyn_pin.simulation.effects import Effects as Effects
    from condyn_pin.simulation.events import Event as Event
    from condyn_pin.simulation.events import Moment as Moment
    from condyn_pin.simulation.integrators import INTEGRATORS as INTEGRATORS
    from condyn_pin.simulation.integrators import Integrator as Integrator
    from condyn_pin.simulation.integrators.dormand_prince import DormandPrince as DormandPrince
    from condyn_pin.simulation.integrators.explicit_euler import ExplicitEuler as ExplicitEuler
    from condyn_pin.simulation.integrators.generalised_alpha import (
        GeneralisedAlpha as GeneralisedAlpha,
    )
    from condyn_pin.simulation.integrators.implicit_midpoint import (
        ImplicitMidpoint as ImplicitMidpoint,
    )
    from condyn_pin.simulation.integrators.leapfrog import Leapfrog as Leapfrog
    from condyn_pin.simulation.integrators.linearly_implicit_midpoint import (
        LinearlyImplicitMidpoint as LinearlyImplicitMidpoint,
    )
    from condyn_pin.simulation.integrators.radau import GearGuptaLeimkuhler as GearGuptaLeimkuhler
    from condyn_pin.simulation.integrators.radau import RadauIIA as RadauIIA
    from condyn_pin.simulation.integrators.rattle import Rattle as Rattle
    from condyn_pin.simulation.integrators.rattle import Shake as Shake
    from condyn_pin.simulation.integrators.runge_kutta4 import RungeKutta4 as RungeKutta4
    from condyn_pin.simulation.integrators.semi_implicit_euler import (
        SemiImplicitEuler as SemiImplicitEuler,
    )
    from condyn_pin.simulation.integrators.stormer_verlet import StormerVerlet as StormerVerlet
    from condyn_pin.simulation.measures import Energy as Energy
    from condyn_pin.simulation.outcome import RunStatus as RunStatus
    from condyn_pin.simulation.run import simulate as simulate
    from condyn_pin.simulation.trajectory import Trajectory as Trajectory
    from condyn_pin.smaller.climbing import Ladder as Ladder
    from condyn_pin.smaller.climbing import LadderEffort as LadderEffort
    from condyn_pin.smaller.climbing import Rung as Rung
    from condyn_pin.smaller.climbing import ladder as ladder
    from condyn_pin.smaller.ladder_table import LadderRow as LadderRow
    from condyn_pin.smaller.ladder_table import LadderTable as LadderTable
    from condyn_pin.smaller.minimal_report import Minimal as Minimal
    from condyn_pin.smaller.minimal_report import Step as Step
    from condyn_pin.smaller.price import Errors as Errors
    from condyn_pin.smaller.reduced_scene import ReducedScene as ReducedScene
    from condyn_pin.solution import Solution as Solution
    from condyn_pin.solution import StateError as StateError
    from condyn_pin.solution import Status as Status
    from condyn_pin.solvers import SOLVERS as SOLVERS
    from condyn_pin.solvers import Solver as Solver
    from condyn_pin.solvers.base import Method as Method
    from condyn_pin.solvers.base import Singular as Singular
    from condyn_pin.solvers.conjugate_gradient import ConjugateGradient as ConjugateGradient
    from condyn_pin.solvers.delassus_cholesky import DelassusCholesky as DelassusCholesky
    from condyn_pin.solvers.dense_kkt import DenseKKT as DenseKKT
    from condyn_pin.solvers.gauss_principle import GaussPrinciple as GaussPrinciple
    from condyn_pin.solvers.lcaba import LCABA as LCABA
    from condyn_pin.solvers.null_space import NullSpace as NullSpace
    from condyn_pin.solvers.proximal import Proximal as Proximal
    from condyn_pin.solvers.reference import Reference as Reference
    from condyn_pin.solvers.soft import Soft as Soft
    from condyn_pin.solvers.sparse_kkt import SparseKKT as SparseKKT
    from condyn_pin.spring import Spring as Spring
    from condyn_pin.states.assembly_report import Assembly as Assembly
    from condyn_pin.states.assembly_report import AssemblyStatus as AssemblyStatus
    from condyn_pin.states.check import Check as Check
    from condyn_pin.states.completion import CompleteState as CompleteState
    from condyn_pin.states.gaps import Gap as Gap
    from condyn_pin.states.integrability import is_integrable as is_integrable
    from condyn_pin.states.rank import Rank as Rank
    from condyn_pin.summary import Summary as Summary
    from condyn_pin.switching import Switch as Switch
    from condyn_pin.switching import switch as switch
    from condyn_pin.trade.cheapest import Choice as Choice
    from condyn_pin.trade.clocks import TimingEffort as TimingEffort
    from condyn_pin.trade.comparison import Comparison as Comparison
    from condyn_pin.trade.measures import MEASURES as MEASURES
    from condyn_pin.trade.measures.acceleration import AccelerationMeasure as AccelerationMeasure
    from condyn_pin.trade.measures.base import Measure as Measure
    from condyn_pin.trade.measures.derivatives import DerivativeMeasure as DerivativeMeasure
    from condyn_pin.trade.measures.forces import ForceMeasure as ForceMeasure
    from condyn_pin.trade.measures.trajectory import TrajectoryMeasure as TrajectoryMeasure
    from condyn_pin.trade.row import Row as Row
    from condyn_pin.trade.scenes import modellings as modellings
    from condyn_pin.trade.states import GivenStates as GivenStates
    from condyn_pin.trade.states import NominalStates as NominalStates
    from condyn_pin.trade.states import PostureStates as PostureStates
    from condyn_pin.trade.states import SampledStates as SampledStates
    from condyn_pin.trade.study import Study as Study
    from condyn_pin.trade.sweeps import sweep as sweep
    from condyn_pin.trade.table import Table as Table
    from condyn_pin.trade.tuning import tune as tune
    from condyn_pin.trade.tuning import tuned as tuned
    from condyn_pin.verbs import derivatives as derivatives
    from condyn_pin.verbs import solve as solve
    from condyn_pin.viewing.verbs import view as view
    from condyn_pin.viewing.viewer import Viewer as Viewer
    from condyn_pin.workspace import Workspace as Workspace

_HOME = {
    "states.assembly_report": ("Assembly", "AssemblyStatus"),
    "audit": ("Audit",),
    "batch.chunks": ("map_chunks",),
    "batch.derivatives": ("BatchDerivatives",),
    "batch.processes": ("Processes",),
    "batch.simulation": ("simulate_batch",),
    "batch.solution": ("BatchSolution",),
    "batch.trajectory": ("BatchTrajectory",),
    "batch.verbs": ("derivatives_batch", "solve_batch"),
    "bridge.cross_check": ("CrossCheck", "TermCheck"),
    "bridge.mujoco_bridge": ("MujocoBridge",),
    "states.check": ("Check",),
    "states.completion": ("CompleteState",),
    "smaller.climbing": ("Ladder", "LadderEffort", "Rung", "ladder"),
    "constraints": ("Constraint", "Coupling", "Loop"),
    "contacts": ("LineContact", "PlanarContact", "PointContact", "SurfaceContact"),
    "differentiation.base": ("Derivatives",),
    "drift": ("Baumgarte", "DRIFTS", "Drift"),
    "drift.no_drift": ("NoDrift",),
    "drift.post_stabilization": ("PostStabilization",),
    "drift.projection": ("Projection",),
    "force": ("ConstraintForce",),
    "impacts": ("Impact", "impact"),
    "rows.terms": ("Terms",),
    "errors": (
        "BranchChanged",
        "BrokenPinocchio",
        "BrowserFailed",
        "CondynError",
        "DerivativesDisagree",
        "Interrupted",
        "InvalidArgument",
        "InvalidConstraint",
        "InvalidModel",
        "MissingExtra",
        "NotAssembled",
        "NotReached",
        "NotTuned",
        "SolveFailed",
        "StepFailed",
        "StaleModel",
        "UnknownName",
        "UnsupportedBackend",
        "UnsupportedConstraint",
        "WorkersLost",
    ),
    "states.gaps": ("Gap",),
    "states.integrability": ("is_integrable",),
    "smaller.ladder_table": ("LadderRow", "LadderTable"),
    "extremes": ("EXTREMES",),
    "ladders": ("LADDERS",),
    "load": ("available_robots", "load_robot"),
    "mechanisms.chain": ("chain",),
    "mechanisms.four_bar": ("four_bar",),
    "mechanisms.n_four_bar": ("n_four_bar",),
    "mechanisms.pendulum": ("pendulum",),
    "mechanisms.rolling_ball": ("rolling_ball",),
    "mechanisms.rolling_disc": ("rolling_disc",),
    "mechanisms.sleigh": ("sleigh",),
    "mechanisms.unicycle": ("unicycle",),
    "motors.actuation": ("Actuation",),
    "motors.inverse": ("InverseDynamics", "gravity_compensation", "inverse_dynamics"),
    "motors.operational": ("OperationalSpace", "operational_space"),
    "motors.transmissions": ("Transmission", "transmission"),
    "nonholonomic": ("Knife", "RollingBall", "RollingWheel"),
    "simulation.effects": ("Effects",),
    "simulation.events": ("Event", "Moment"),
    "simulation.integrators": ("INTEGRATORS", "Integrator"),
    "simulation.integrators.dormand_prince": ("DormandPrince",),
    "simulation.integrators.explicit_euler": ("ExplicitEuler",),
    "simulation.integrators.generalised_alpha": ("GeneralisedAlpha",),
    "simulation.integrators.implicit_midpoint": ("ImplicitMidpoint",),
    "simulation.integrators.leapfrog": ("Leapfrog",),
    "simulation.integrators.linearly_implicit_midpoint": ("LinearlyImplicitMidpoint",),
    "simulation.integrators.radau": (
        "GearGuptaLeimkuhler",
        "RadauIIA",
    ),
    "simulation.integrators.rattle": (
        "Rattle",
        "Shake",
    ),
    "simulation.integrators.stormer_verlet": ("StormerVerlet",),
    "simulation.integrators.runge_kutta4": ("RungeKutta4",),
    "simulation.integrators.semi_implicit_euler": ("SemiImplicitEuler",),
    "simulation.measures": ("Energy",),
    "simulation.run": ("simulate",),
    "simulation.outcome": ("RunStatus",),
    "simulation.trajectory": ("Trajectory",),
    "smaller.minimal_report": ("Minimal", "Step"),
    "smaller.price": ("Errors",),
    "problems": ("PROBLEMS", "Problem"),
    "problems.loading": ("load_problem",),
    "problems.result": ("ProblemResult",),
    "proof": ("Proof",),
    "states.rank": ("Rank",),
    "smaller.reduced_scene": ("ReducedScene",),
    "robot": ("Robot",),
    "scene": ("Scene",),
    "solution": ("Solution", "StateError", "Status"),
    "solvers": ("SOLVERS", "Solver"),
    "solvers.base": ("Method", "Singular"),
    "solvers.conjugate_gradient": ("ConjugateGradient",),
    "solvers.delassus_cholesky": ("DelassusCholesky",),
    "solvers.dense_kkt": ("DenseKKT",),
    "solvers.gauss_principle": ("GaussPrinciple",),
    "solvers.lcaba": ("LCABA",),
    "solvers.null_space": ("NullSpace",),
    "solvers.proximal": ("Proximal",),
    "solvers.reference": ("Reference",),
    "solvers.soft": ("Soft",),
    "solvers.sparse_kkt": ("SparseKKT",),
    "spring": ("Spring",),
    "summary": ("Summary",),
    "switching": ("Switch", "switch"),
    "trade.cheapest": ("Choice",),
    "trade.comparison": ("Comparison",),
    "trade.tuning": ("tune", "tuned"),
    "trade.clocks": ("TimingEffort",),
    "trade.measures": ("MEASURES",),
    "trade.measures.base": ("Measure",),
    "trade.measures.acceleration": ("AccelerationMeasure",),
    "trade.measures.derivatives": ("DerivativeMeasure",),
    "trade.measures.forces": ("ForceMeasure",),
    "trade.measures.trajectory": ("TrajectoryMeasure",),
    "trade.row": ("Row",),
    "trade.scenes": ("modellings",),
    "trade.states": (
        "GivenStates",
        "NominalStates",
        "PostureStates",
        "SampledStates",
    ),
    "trade.study": ("Study",),
    "trade.sweeps": ("sweep",),
    "trade.table": ("Table",),
    "verbs": ("derivatives", "solve"),
    "viewing.verbs": ("view",),
    "viewing.viewer": ("Viewer",),
    "workspace": ("Workspace",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
