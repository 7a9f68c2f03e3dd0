"""Every public name says what it takes, in which shape, what comes back, and what goes wrong."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from shared import each_row

import condyn_pin as cp

pytestmark = pytest.mark.once

ROOMS = [cp, *(room for name in cp.__all__ if inspect.ismodule(room := getattr(cp, name)))]
PUBLIC = {
    name: value
    for room in ROOMS
    for name in room.__all__
    if not inspect.ismodule(value := getattr(room, name))
}
FUNCTIONS = [name for name, value in PUBLIC.items() if inspect.isfunction(value)]
CLASSES = [name for name, value in PUBLIC.items() if inspect.isclass(value)]
METHODS = {
    **cp.dynamics.SOLVERS, **cp.simulation.INTEGRATORS, **cp.simulation.DRIFTS,
    **cp.contact.CONTACT_SOLVERS,
}  # fmt: skip
# Functions that compute, and those of them whose equations are of the literature.
VERBS = (
    "solve", "derivatives", "inverse_dynamics", "gravity_compensation", "operational_space",
    "transmission", "impact", "switch", "solve_contact", "is_integrable", "simulate", "solve_batch",
    "derivatives_batch", "simulate_batch", "tune",
)  # fmt: skip
SOURCED = VERBS[:10]
COST = re.compile(r"\bCosts?\b|\bTakes\b|\b(us|ms)\b")
SOURCE = re.compile(r"^References$|source are those of", re.MULTILINE)
# What means the same everywhere: methods need not say it again, the first page of the API does.
KNOWN = {"q", "v", "a", "tau", "lam", "t", "dt", "scene", "path", "workspace", "system", "terms"}
# Words that make an entry speak of a quantity, and the shapes and units that it then has to have.
ARRAYS = re.compile(r"\barray(_like)?\b")
NUMBERS = re.compile(r"\bfloat\b|\barray(_like)?\b(?! of (int|bool|str))")
COUNTS = re.compile(r"\bof (int|bool|str)\b|\bint\d+\b|\bSolver\b")
UNIT = re.compile(r"\[[^\]]+\]")
# Names whose unit the first page of the API says, once for all.
CONVENTIONAL = {
    "q", "v", "a", "tau", "lam", "t", "dt", "Q", "V", "q0", "v0", "Q0", "V0", "M", "h", "J",
    "gamma", "a_ref", "da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau",
}  # fmt: skip
# What is a pure number, or has the unit of whatever it is a share of.
DIMENSIONLESS = {
    "accuracy", "error", "limit", "condition", "delassus_condition", "rank_tolerance", "common",
    "relative_tolerance", "absolute_tolerance", "absolute_accuracy", "restitution", "rho", "normal",
    "a_worst", "a_median", "force_worst", "force_median", "error_median", "error_worst",
}  # fmt: skip
# The same of one name alone, and why.
OTHER = {
    ("BatchSolution", "residuals"): "columns of several units, each a property that has its own",
    ("Check", "speed"): "a scale, the larger of a velocity and one",
    ("ReducedScene", "held"): "a configuration, as q",
    ("Assembly", "start"): "a configuration, as q",
    ("SampledStates", "spread"): "as in Scene.sample",
    ("SampledStates", "speed"): "as in Scene.sample",
    ("view", "speed"): "seconds of a motion in a second",
}
REFUSES = re.compile(r"\braise\b|\b(check_\w+|finite|text)\(")
SHAPE = re.compile(r"\((?:[^()]*,[^()]*)\)|(?:list|tuple|dict) of")


def text(thing: Any) -> str:
    return inspect.getdoc(thing) or ""


def sections(doc: str) -> dict[str, str]:
    """The numpydoc sections of a docstring; what comes before them is that of the empty name."""
    parts = re.split(r"^([A-Z][\w ]+)\n-{3,}\n", doc, flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def entries(section: str) -> dict[str, str]:
    """The entries of a section by name: `q, v : type` are two."""
    found = {}
    for head, body in re.findall(
        r"^(\S.*)\n?((?:(?:[ \t].*)?\n?)*?)(?=^\S|\Z)", section, re.MULTILINE
    ):
        names, _, kind = head.partition(" : ")
        for name in names.split(","):
            found[name.strip().lstrip("*")] = f"{kind}\n{body}"
    return found


def parameters(function: Any) -> list[str]:
    names = inspect.signature(function).parameters
    return [name for name in names if name not in ("self", "cls") and not name.startswith("_")]


def quantities(name: str) -> Iterator[tuple[str, str]]:
    """Entries of a docstring that are numbers, and not counts, with their words."""
    said = sections(text(PUBLIC[name]))
    for title in ("Parameters", "Attributes", "Returns", "Yields"):
        for entry, body in entries(said.get(title, "")).items():
            kind = body.split("\n")[0] or entry
            if NUMBERS.search(kind) and not COUNTS.search(kind):
                yield entry, body


# What may be wrong with a public name, a sentence each


def first_line(name: str) -> Iterator[str]:
    first = text(PUBLIC[name]).split("\n")[0]
    if name in FUNCTIONS + CLASSES and not re.fullmatch(r"[A-Z].{9,}[.:]", first):
        yield f"its first line is no sentence: {first!r}"


def what_is_taken_returned_and_raised(name: str) -> Iterator[str]:
    if name not in FUNCTIONS:
        return
    function, said = PUBLIC[name], sections(text(PUBLIC[name]))
    if set(entries(said.get("Parameters", ""))) != set(parameters(function)):
        wanted, there = set(parameters(function)), set(entries(said.get("Parameters", "")))
        yield f"Parameters lacks {wanted - there} and has {there - wanted} too many"
    nothing = inspect.signature(function).return_annotation in (None, "None")
    if not nothing and not {"Returns", "Yields"} & said.keys():
        yield "it does not say what comes back"
    raised = re.findall(r"raise (?:errors\.)?([A-Z]\w+)\(", inspect.getsource(function))
    for error in set(raised) - set(re.findall(r"\w+", said.get("Raises", ""))):
        yield f"it raises {error}, which its section Raises does not name"


def fields(name: str) -> Iterator[str]:
    """As a parameter or an attribute, its own or that of the class that it has the field from."""
    kind = PUBLIC[name]
    every = set(getattr(kind, "_fields", ()))  # of a named tuple
    if dataclasses.is_dataclass(kind):
        every = {field.name for field in dataclasses.fields(kind)}
    listed: set[str] = set()
    for base in getattr(kind, "__mro__", ()):
        said = sections(inspect.cleandoc(base.__doc__ or ""))
        for title in ("Parameters", "Attributes"):
            listed |= entries(said.get(title, "")).keys()
    for field in {field for field in every if not field.startswith("_")} - listed:
        yield f"its field {field} is neither in Parameters nor in Attributes"


def refusals(name: str) -> Iterator[str]:
    """What a class does not take, if it looks at what it is given."""
    check = vars(PUBLIC[name]).get("__post_init__")
    if (
        check
        and REFUSES.search(inspect.getsource(check))
        and "Raises" not in sections(text(PUBLIC[name]))
    ):
        yield "it does not say what it refuses"


def methods(name: str) -> Iterator[str]:
    """What a class defines itself and others may call; what only fills a contract has its words."""
    kind = PUBLIC[name]
    if name not in CLASSES or name == "Processes":  # an Executor: its methods are Python's
        return
    for method, value in vars(kind).items():
        function = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
        if method.startswith("_") or not inspect.isfunction(function):
            continue
        if any(text(vars(base).get(method)) for base in kind.__mro__[1:]):
            continue
        said = text(function)
        if not said:
            yield f"{method} says nothing"
        for parameter in parameters(function):
            if parameter not in KNOWN and not re.search(rf"\b{parameter}\b", said):
                yield f"{method} does not say what {parameter} is"


def shapes(name: str) -> Iterator[str]:
    said = sections(text(PUBLIC[name]))
    for title in ("Parameters", "Attributes", "Returns"):
        for entry, body in entries(said.get(title, "")).items():
            kind = body.split("\n")[0] if title != "Returns" else entry
            if ARRAYS.search(kind) and not SHAPE.search(kind) and not SHAPE.search(body):
                yield f"{entry} : {kind} has no shape"


def units(name: str) -> Iterator[str]:
    for entry, body in quantities(name):
        said = entry in CONVENTIONAL | DIMENSIONLESS or (name, entry) in OTHER
        if not said and not UNIT.search(body):
            yield f"{entry} has no unit in brackets, such as [m]; [1] for a pure number"


def verbs(name: str) -> Iterator[str]:
    said = text(PUBLIC[name])
    if name in VERBS and not ("Raises" in sections(said) and COST.search(said)):
        yield "a computation says what goes wrong, and what it costs"
    if name in SOURCED and not SOURCE.search(said):
        yield "it names no source"


RULES = (
    first_line, what_is_taken_returned_and_raised, fields, refusals, methods, shapes, units, verbs,
)  # fmt: skip


@each_row("rule", RULES)
def test_public_names_are_documented(rule):
    names = [name for name in PUBLIC if name in FUNCTIONS or name in CLASSES]
    assert len(names) > 150
    faults = [f"{name}: {fault}" for name in names for fault in rule(name)]
    assert not faults, "docstrings of public names:\n" + "\n".join(faults)


@pytest.mark.long
def test_no_exception_from_units_is_idle():
    seen = {(name, entry) for name in [*FUNCTIONS, *CLASSES] for entry, _ in quantities(name)}
    idle = OTHER.keys() - seen, DIMENSIONLESS - {entry for _, entry in seen}
    assert idle == (set(), set()), f"remove from OTHER, DIMENSIONLESS what no docstring has: {idle}"
    gone = set(VERBS) - PUBLIC.keys()
    assert not gone, f"VERBS names {gone}, which are not public"


def test_what_means_the_same_everywhere_is_said_on_the_first_page_with_its_unit():
    page = (Path(cp.__file__).parents[1] / "docs" / "reference.py").read_text(encoding="utf-8")
    table = page.split('_INTRODUCTION = """')[1].split('"""')[0]
    with_unit = [row for row in re.split(r"\n(?=``)", table) if UNIT.search(row)]
    unsaid = KNOWN - set(re.findall(r"``(\w+)``", table))
    assert not unsaid, f"the table in docs/reference.py lacks {unsaid}"
    unsaid = CONVENTIONAL - set(re.findall(r"``(\w+)``", "".join(with_unit)))
    assert not unsaid, f"the table in docs/reference.py says no unit of {unsaid}"


def test_a_method_has_a_cost_a_use_and_a_source():
    for name, kind in METHODS.items():
        assert kind.use, f"{name}: `use` is empty; it says when to take the method"
        cost = getattr(kind, "cost", "") or kind.solves_per_step
        assert cost, f"{name}: set `cost`, or `solves_per_step` of an integrator"
        cited = name == "nodrift" or "References" in sections(text(kind))
        assert cited, f"{name}: its docstring needs a section References with the paper"
