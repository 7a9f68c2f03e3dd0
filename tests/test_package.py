"""The package itself: names, lightness, version differences in one place."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import condyn_pin as cp

PACKAGE = Path(cp.__file__).parent


ROOMS = ("", *(path.parent.name for path in sorted(PACKAGE.glob("*/__init__.pyi"))))


@pytest.mark.parametrize("room", ROOMS)
def test_a_stub_lists_public_names_and_nothing_else(room):
    text = (PACKAGE / room / "__init__.pyi").read_text(encoding="utf-8")
    imports = [line for line in ast.parse(text).body if isinstance(line, ast.ImportFrom)]
    # without "as" a type checker takes it for the stub's own
    bare = [alias.name for line in imports for alias in line.names if alias.asname != alias.name]
    assert not bare, f"condyn_pin/{room}/__init__.pyi: write `{bare[0]} as {bare[0]}`"
    names = [alias.name for line in imports for alias in line.names]
    module = importlib.import_module(f"condyn_pin.{room}".rstrip("."))
    assert sorted(module.__all__) == sorted(names)
    assert len(set(names)) == len(names), "a name is listed twice"
    for name in names:
        value = getattr(module, name)
        assert isinstance(value, dict) or value.__doc__, f"{name} needs a docstring"
        assert name in dir(module)


def test_the_top_is_small():
    """What a user meets first, and the rooms with all else."""
    assert len(cp.__all__) <= 54, (
        f"condyn_pin/__init__.pyi lists {len(cp.__all__)} names, at most 54 may be: list a new "
        "one in the __init__.pyi of its room"
    )


def test_no_two_public_classes_share_a_name():
    """A name that a room and the top have is the same thing in both."""
    seen = {}
    for room in ROOMS:
        module = importlib.import_module(f"condyn_pin.{room}".rstrip("."))
        for name in module.__all__:
            value = getattr(module, name)
            if not inspect.ismodule(value):
                first = seen.setdefault(name, value)
                assert first is value, f"{name} is public twice: {first} and {value}; rename one"


@pytest.mark.parametrize(
    ("old", "now"),
    [
        ("tune", "study.tune"),
        ("Gap", "constraints.ConstraintViolation"),
        ("Knife", "constraints.KnifeEdge"),
    ],
)
def test_a_name_of_the_last_version_is_forwarded_and_says_so(old, now):
    with pytest.warns(DeprecationWarning, match=f"condyn_pin.{old} is condyn_pin.*{now}"):
        value = getattr(cp, old)
    assert value.__name__ == now.rpartition(".")[2]


@pytest.mark.parametrize(
    ("room", "old", "now"),
    [
        ("contact", "Attempt", "SolverResult"),
        ("control", "Give", "Relaxation"),
        ("mechanism", "put_down", "place_on_ground"),
    ],
)
def test_a_name_that_a_room_had_is_forwarded(room, old, now):
    module = importlib.import_module(f"condyn_pin.{room}")
    with pytest.warns(DeprecationWarning, match=f"{room}.{old} is condyn_pin.{room}.{now} now"):
        assert getattr(module, old) is getattr(module, now)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = cp.nothing


@pytest.mark.parametrize("name", ["lab", "EXTREMES", "LADDERS"])
def test_what_measures_the_library_says_where_it_went(name):
    with pytest.raises(AttributeError, match=f"'{name}': it measures the library and lives in a c"):
        getattr(cp, name)


def modules_after(code: str) -> set[str]:
    program = f"{code}\nimport sys; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return {name.split(".")[0] for name in result.stdout.split()}


def test_import_stays_light():
    early = modules_after("import condyn_pin") & {"pinocchio", "numpy", "scipy", "typer"}
    assert not early, f"`import condyn_pin` imports {early}: list names in .pyi files instead"


def test_using_it_imports_only_what_it_needs():
    code = """
import condyn_pin as cp
bar = cp.model.four_bar()
scene = cp.Scene(bar, bar.loops)
cp.Workspace
"""
    heavy = {"matplotlib", "meshcat", "typer", "rich", "mujoco", "hypothesis"}
    early = modules_after(code) & heavy
    assert not early, f"a scene imports {early}: import it in the function that uses it"


def test_without_the_compiled_core_python_works_where_that_may_be():
    """With "where possible" by Python; with True by an error that says how to build the core."""
    code = """
import sys
sys.modules["condyn_pin_native"] = None
import numpy as np
import condyn_pin as cp
from condyn_pin.control import Controller, Posture

solo = cp.load_robot("solo12")
scene = cp.Scene(solo, solo.contacts)
q, v = scene.state()
cone = cp.contact.FrictionCone(0.6, sides=8)
willing = cp.Native(threads=2, where_possible=True)
for engine, by in (("python", None), ("auto", willing)):
    solution = cp.Workspace(scene, engine=engine).solve(q, v, 0 * v)
    slopes = cp.Workspace(scene, engine=engine).derivatives(q, v, 0 * v)
    tick = Controller(scene, [Posture()], cones=cone, engine=engine).solve(q, v)
    many = cp.solve_batch(scene, [q], [v], 0, executor=by)
    fall = cp.simulate_batch(scene, [q], [v], duration=0.01, executor=by)
    print(*solution.a, *slopes.da_dq.flat, *tick.tau, *many.a.flat, *fall.q.flat)
for wanted in (
    lambda: cp.Workspace(scene, engine="core"),
    lambda: Controller(scene, [Posture()], cones=cone, engine="core"),
    lambda: cp.Native(),
):
    try:
        wanted()
    except cp.errors.MissingExtra as error:
        print(error)
"""
    run = [sys.executable, "-c", code]
    said = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    python, willing = ([float(x) for x in line.split()] for line in said[:2])
    assert willing == pytest.approx(python, rel=1e-9, abs=1e-9)  # memory lies elsewhere: rounding
    assert len(said) == 5
    assert all("pip install ./native" in line for line in said[2:])


@pytest.mark.long
def test_marker_for_type_checkers_is_there():
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.long
def test_nothing_relies_on_a_wider_long_double():
    for path in PACKAGE.rglob("*.py"):
        found = "longdouble" in path.read_text().replace("long double", "")
        assert not found, f"{path}: long doubles differ by platform; use the exact sums of linalg"


def test_what_a_build_of_the_core_is_told_is_known_to_it():
    """CMake takes a definition that nothing reads without a word."""
    root = PACKAGE.parent
    pages = [*root.glob("docs/*.md"), *root.glob("*.md"), root / "native" / "README.md"]
    pages += (root / "tests").glob("*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in pages)
    told = set(re.findall(r"cmake\.define\.(CONDYN_[A-Z]+)", text))
    build = (root / "native" / "CMakeLists.txt").read_text(encoding="utf-8")
    assert {"CONDYN_ARCH", "CONDYN_SANITIZE"} <= told
    for name in told:
        # it has a default, and is used
        assert build.count(name) > 1, f"native/CMakeLists.txt does not read {name}"


def test_contributing_says_where_everything_is():
    text = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text.partition("## Where things are")[2].partition("\n## ")[0]
    first = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    said = re.findall(r"`([\w/]+(?:\.py|/))`", "".join(first))
    there = [path.name for path in PACKAGE.glob("*.py")]
    there += [f"{path.parent.relative_to(PACKAGE)}/" for path in PACKAGE.glob("*/**/__init__.py")]
    missing = set(there) - set(said) - {"__init__.py"}
    assert not missing, f"the first column of `Where things are` in CONTRIBUTING.md lacks {missing}"
    gone = [each for each in said if not (PACKAGE / each).exists()]
    assert not gone, f"`Where things are` in CONTRIBUTING.md names {gone}, which do not exist"


def test_the_workflow_runs_what_ci_runs():
    """One script decides, on every machine; hooks use the tools that are installed."""
    root = Path(__file__).parent.parent
    workflow = (root / ".github" / "workflows" / "ci.yml").read_text("utf-8")
    assert "- run: bash .ci/run" in workflow
    assert (root / ".ci" / "run").is_file()
    hooks = (root / ".pre-commit-config.yaml").read_text("utf-8")
    assert "repo: local" in hooks
    assert "https://" not in hooks
