"""Native: who does the work in compiled code."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

from condyn_pin._core.compiled import compiled
from condyn_pin._core.parallel.processes import cores
from condyn_pin._core.parameters import check_count
from condyn_pin.errors import InvalidArgument

_MOST = 1000  # threads


@dataclass(frozen=True)
class Native:
    """The compiled core, as ``executor=`` of all batch verbs.

    It returns what Python would return. States whose check leaves a doubt, such as those near
    singular postures, are passed to Python.

    Parameters
    ----------
    threads : int, optional
        As many as there are cores for this process by default. They work at the same time: the
        core does not hold the GIL.
    executor : Executor, optional
        Whose workers use the core, each with so many threads: `Processes`, or Dask's
        ``client.get_executor()``. This process by default.
    where_possible : bool
        What the core does not take, such as torques that are a function, raises
        `UnsupportedBackend` by default; with True Python does that, and everything where no core is
        installed.

    Raises
    ------
    MissingExtra
        If the core is not installed, unless `where_possible`.

    Notes
    -----
    ``pip install ./native`` builds it (`docs/how-to-run-at-scale.md`).
    """

    threads: int | None = None
    executor: Executor | None = None
    where_possible: bool = False

    def __post_init__(self) -> None:
        if self.threads is not None:
            check_count("threads", self.threads, most=_MOST)
        if not isinstance(self.executor, Executor | None):
            raise InvalidArgument(
                f"executor = {self.executor!r}: a concurrent.futures.Executor is needed, such as "
                "Processes(2), or client.get_executor() of a Dask client"
            )
        if not isinstance(self.where_possible, bool):
            raise InvalidArgument(f"where_possible = {self.where_possible!r}: True or False")
        if not self.where_possible:
            compiled()

    @property
    def at_work(self) -> int:
        """How many threads there are."""
        return cores() if self.threads is None else self.threads
