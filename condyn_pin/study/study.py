"""Study: which solver with which parameters costs how much, and is how wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

from condyn_pin._core.arguments import check_accuracy_of_a
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.bench import Progress, silent
from condyn_pin.study.clocks import TimingEffort
from condyn_pin.study.measures import Measure
from condyn_pin.study.measures.base import as_measure
from condyn_pin.study.method import Method
from condyn_pin.study.scenes import Scenes, labelled
from condyn_pin.study.states import NoisyStates, States, as_states
from condyn_pin.study.sweeps import default_sweep
from condyn_pin.study.table import Table


@dataclass(frozen=True, eq=False)
class Study:
    """Solvers on scenes, measured: time and error in the same run.

    Parameters
    ----------
    scenes : Scene, name of a robot, mapping of labels to Scene, or several of the first two
        The name of a robot stands for its standard scenes, of which the first measure says what
        they are; `modellings` gives other ways to model
        the same machine, and ``HIERARCHIES[name].scenes()`` smaller ones.
    solvers : sequence of Solver, or of what the measure asks, optional
        By default all but `Reference`, each with the parameters that it declares worth a look;
        `sweep` makes others.
    states : States or int
        The states; a number is that many of `SampledStates`.
    measure : name of `MEASURES`, Measure, or several
        What the error is one of.
    accuracy : float
        Error of a that a status of ok promises.
    effort : TimingEffort
        How long to time.
    noise : float or (float, float)
        What sensors are off by: q [rad, m] and v [rad/s, m/s]; one number is both. The truth is
        that of the closed machine beside each state, so that errors are of the order of the noise;
        an answer that is ok is wrong from a tenth on.

    Raises
    ------
    InvalidArgument
        If the accuracy is finer than doubles can have, or there is no measure, no scene, or no such
        solver, or the noise is negative.

    Examples
    --------
    ::

        table = Study("cassie", sweep(Proximal(), mu=[1e-8, 1e-6, 1e-4])).run()
    """

    scenes: Scenes
    solvers: Sequence[Method] | None = None
    states: States | int = 20
    measure: Measure | str | Sequence[Measure | str] = "acceleration"
    accuracy: float = SOLVED
    effort: TimingEffort = field(default_factory=TimingEffort)
    noise: float | tuple[float, float] = 0.0  # [rad, m; rad/s, m/s]

    def __post_init__(self) -> None:
        check_accuracy_of_a(self.accuracy)
        if not self.measures:
            raise InvalidArgument("measure = []: at least one is needed")
        if self.solvers is not None:
            object.__setattr__(self, "solvers", _methods(self.solvers, self.measures))
        if not isinstance(self.effort, TimingEffort):
            raise InvalidArgument(f"effort = {self.effort!r}: TimingEffort(rounds=...) is needed")
        object.__setattr__(self, "scenes", labelled(self.scenes, self.measures[0].scenes_of))
        states = as_states(self.states)
        noisy = NoisyStates(states, self.noise)
        object.__setattr__(self, "states", states if noisy.exact else noisy)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The measures, each once."""
        several = [self.measure] if isinstance(self.measure, Measure | str) else self.measure
        return tuple(dict.fromkeys(as_measure(one) for one in several))

    def solvers_on(self, scene: Scene, measure: Measure) -> tuple[Method, ...]:
        """Return what a scene is measured with.

        Parameters
        ----------
        scene : Scene
        measure : Measure
            It says what is asked: solvers, or contact solvers.
        """
        return default_sweep(scene, measure) if self.solvers is None else tuple(self.solvers)

    def run(
        self,
        *,
        executor: Executor | None = None,
        progress: Progress = silent,
        timed: bool = True,
        results: str | Path | None = None,
    ) -> Table:
        """Measure.

        Errors first, then times, all solvers of a scene interleaved. The same study gives the same
        errors to the bit, with an executor or without.

        Parameters
        ----------
        executor : concurrent.futures.Executor, optional
            Where errors are computed: `Processes`, Dask's ``Client.get_executor()``. Threads bring
            nothing, Pinocchio holds the lock of the interpreter. Times are always taken here, after
            the last error, and say whether this process had a core for itself.
        progress : callable
            Called with (what, done, total).
        timed : bool
            Take times too.
        results : str or Path, optional
            A file that rows are appended to as they are measured. Those that are in it already are
            not measured again: a study that was stopped goes on.

        Returns
        -------
        Table
            A row a scene, measure and solver, in this order.

        Raises
        ------
        NotAssembled
            If the loops of a scene cannot be closed; before anything is measured.
        Interrupted
            On Ctrl-C; its `table` has what was measured.
        WorkersLost
            If the executor cannot go on after the loss of a worker, as a ``ProcessPoolExecutor``
            cannot; its `done` is a table of what was measured.
        InvalidArgument
            If `results` is not such a file.
        """
        from condyn_pin.study.running import Run

        return Run(self, executor, progress, timed, results).table()


def _methods(given: Sequence[Method], measures: Sequence[Measure]) -> tuple[Method, ...]:
    several = list(given) if isinstance(given, Iterable) else [given]
    for method in several:
        for measure in measures:
            if not isinstance(method, measure.asks):
                raise InvalidArgument(
                    f"solvers: {method!r} is no {measure.asks.__name__}, which {measure.name} "
                    f"asks: {', '.join(kind.__name__ for kind in measure.methods.values())}"
                )
    if not several:
        raise InvalidArgument("solvers = []: at least one is needed")
    return tuple(dict.fromkeys(several))
