"""How many files a reader of one call meets, where the equations are written, imports, and words.

Bounds are what was reached: they go down, and only a new idea in the call itself takes one up.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Callable
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from shared import imported_by_a_solve, robot

import condyn_pin as cp
from condyn_pin.control import CenterOfMass, Orientation, Posture

HOUSE = Path(cp.__file__).parent

pytestmark = pytest.mark.once  # Pinocchio has no part in them


def files_of(call: Callable[[], object]) -> list[str]:
    """Files of the library in which functions are called, in turn."""
    turns: list[str] = []

    def look(frame: FrameType, event: str, _: object) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(HOUSE):
            name = path.relative_to(HOUSE).as_posix()
            if not turns or turns[-1] != name:
                turns.append(name)

    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(None)
    return turns


def cassie() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Closed loops, with a velocity."""
    scene = cp.Scene(robot("cassie"), robot("cassie").loops)
    return scene, *scene.sample(np.random.default_rng(1))


def solo(*, opens: bool) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Four feet on the ground, that may open or not."""
    its, feet = robot("solo12"), robot("solo12").contacts
    if not opens:
        scene = cp.Scene(its, feet)
    else:
        touches = [cp.FrictionalContact(foot.frame, friction=0.7) for foot in feet]
        scene = cp.Scene(its, contacts=touches)
    return scene, *scene.state()


def solve() -> Callable[[], object]:
    scene, q, v = cassie()
    return lambda: cp.solve(scene, q, v, np.zeros(len(v)))


def derivatives() -> Callable[[], object]:
    scene, q, v = cassie()
    return lambda: cp.derivatives(scene, q, v, np.zeros(len(v)))


def step() -> Callable[[], object]:
    scene, q, v = solo(opens=True)
    return lambda: cp.step(scene, q, v, dt=1e-3)


def control() -> Callable[[], object]:
    scene, q, v = solo(opens=False)
    stand = [
        CenterOfMass(kp=20, weight=100),
        Orientation("base_link", weight=50),
        Posture("standing", weight=0.1),
    ]
    controller = cp.Controller(scene, stand, cones=cp.contact.FrictionCone(0.6))
    return lambda: controller.solve(q, v)


@pytest.mark.parametrize(
    ("made", "most"), [(solve, 12), (derivatives, 16), (step, 29), (control, 23)]
)
def test_a_warm_call_is_read_in_few_files(made, most):
    call = made()
    for _ in range(2):  # a second one fills what is kept for later ones
        call()
    found = set(files_of(call))
    assert len(found) <= most, sorted(found)


def test_one_more_step_is_read_in_few_files():
    scene, q, v = cassie()

    def run(steps: int) -> list[str]:
        return files_of(lambda: cp.simulate(scene, q, v, duration=1e-3 * steps, record=100))

    run(3)
    shorter, longer = run(8), run(9)
    more = Counter(longer) - Counter(shorter)
    assert len(more) <= 6, sorted(more)
    assert more.total() <= 20, more


# Where the residuals are evaluated.

# Newton-Euler by `rnea`: in the equations, for what joints pass on, in place of a product with M
# that is not formed, and in an iteration that closes c(q) with its own rows.
BY_NEWTON_EULER = {
    "constraints/rows/equations.py",
    "dynamics/bearings.py",
    "dynamics/solvers/minimum_residual.py",
    "simulation/integrators/integrator.py",
}


@cache
def parsed() -> dict[str, ast.Module]:
    """Syntax of every file of the library, by its place."""
    return {
        path.relative_to(HOUSE).as_posix(): ast.parse(path.read_text("utf-8"))
        for path in sorted(HOUSE.rglob("*.py"))
    }


def test_residuals_are_those_of_the_equations():
    """M a + h - tau - J^T lam and J a + gamma - a_ref have one home, `Equations.residuals`."""
    found = {
        name
        for name, tree in parsed().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "rnea"
    }
    assert found == BY_NEWTON_EULER


# Imports: at the top of a file, but for circles and what a first solve does without.


# Rooms above, which `pyproject.toml` has among its exceptions.
UPWARDS = {
    ("condyn_pin.stepping.single_step", "condyn_pin.gradients.routes.step_derivatives"),
    ("condyn_pin.dynamics.solvers.soft", "condyn_pin.io.mjcf_write"),
    ("condyn_pin.constraints.contacts.ground", "condyn_pin.io.meshes"),
}

# Rooms and files that import in turn when they are asked, and names of registries that fill then.
ON_DEMAND = (
    "__main__.py",
    "cli/",
    "io/",
    "layers/",
    "study/",
    "control/controller.py",
    "_core/doctor.py",
)
REGISTRIES = {"INTEGRATORS", "MECHANISMS", "SOLVERS"}


def imported(node: ast.AST, modules: set[str]) -> set[str]:
    """Modules of the library that a statement imports."""
    if isinstance(node, ast.ImportFrom) and node.module:
        names = {f"{node.module}.{each.name}" for each in node.names} & modules
        return names or {node.module} & modules
    return {each.name for each in node.names} & modules if isinstance(node, ast.Import) else set()


def is_registry(node: ast.AST) -> bool:
    """True if a statement imports a registry."""
    return isinstance(node, ast.ImportFrom) and {each.name for each in node.names} <= REGISTRIES


def with_rooms(module: str) -> set[str]:
    """A module, and the packages whose files are read before it."""
    parts = module.split(".")
    return {".".join(parts[:i]) for i in range(1, len(parts) + 1)}


def test_imports_stand_at_the_top():
    """In functions and under TYPE_CHECKING: circles, and what a first solve does without."""
    trees = {
        f"condyn_pin.{name[:-3].replace('/', '.')}".removesuffix(".__init__"): (name, tree)
        for name, tree in parsed().items()
    }
    modules, first = set(trees), imported_by_a_solve()
    at_top: dict[str, set[str]] = {name: set() for name in trees}
    later: dict[str, set[str]] = {name: set() for name in trees}
    for name, (_, tree) in trees.items():
        for node in tree.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                at_top[name].update(*map(with_rooms, imported(node, modules)))
            else:
                within = (each for each in ast.walk(node) if not is_registry(each))
                later[name].update(*(imported(each, modules) for each in within))

    def reached(name: str) -> set[str]:
        seen, left = set[str](), [name]
        while left:
            one = left.pop()
            if one not in seen:
                seen.add(one)
                left += at_top[one]
        return seen

    needless = [
        (name, other)
        for name, others in later.items()
        for other in others
        if name not in (there := reached(other))
        and not (name in first and there - first)
        and not trees[name][0].startswith(ON_DEMAND)
        and (name, other) not in UPWARDS
    ]
    assert not needless, f"import these at the top: {needless}"


def test_modules_import_in_no_circle():
    """What a module imports at its top is read whole before it: faces of rooms fill on demand."""
    trees = {
        f"condyn_pin.{name[:-3].replace('/', '.')}": tree
        for name, tree in parsed().items()
        if not name.endswith("__init__.py")
    }
    modules = set(trees)
    after = {
        name: set().union(*(imported(node, modules) for node in tree.body), set())
        for name, tree in trees.items()
    }
    try:
        list(TopologicalSorter(after).static_order())
    except CycleError as error:
        pytest.fail(f"modules that import each other at their tops: {' -> '.join(error.args[1])}")


# Words: a noun of the field is the subject, and verbs have objects.


# Turns of phrase that name nothing, and what stands in their place.
BANNED = {
    r"\b(takes?|took|taking) part\b": "is active",
    r"\b(lets?|letting) go\b": "opens, releases",
    r"\b(gives?|gave|giving) way\b": "yields, is compliant",
    r"\b(says?|said|saying) so\b": "names it, refuses, warns",
    r"(?<!`)\basks\b(?! for)": "needs, depends on",
    r"\bfor ever\b(?! \w)": "forever",
    r"\bmended\b": "repaired",
    r"\bwhoever\b": "the one who is meant",
    r"\bReturn (the same|what|whether|who|where|how)\b": "the quantity that is returned",
}

# On pages also sentences and headings about "what", which a noun would tell; a question may ask it.
# `docs/style.md` has them with their cures.
BANNED_ON_PAGES = BANNED | {
    r"(?<![\"*])\bWhat(ever)? (?!it does not do)[^.?:]*[.:]": "a noun of the field",
    r"# What(ever)? (?!it does not do)[^?]*$": "a noun of the field",
    r"\bsays (why|what|how|where|when|which|who|whether)\b": "names, gives, lists",
    r"\btakes\b": "needs, accepts, uses, costs",
    r"(?<!`)\basks\b": "needs, commands",
}
# The style quotes them, and results are of measured times: "a step takes 3 us".
APART = ("docs/style.md", "docs/results.md")


def texts_of(tree: ast.Module) -> list[tuple[int, str]]:
    """Docstrings and other texts of a file with their lines; those of names are texts too."""
    return [
        (node.lineno, node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def banned_in(place: str, text: str, banned: dict[str, str] = BANNED) -> list[str]:
    """A sentence for each banned phrase in a text, whose lines may break anywhere."""
    words = " ".join(text.split())
    return [
        f"{place}: {found.group()!r} names no quantity; write {better!r}, or the field's own word"
        for phrase, better in banned.items()
        for found in re.finditer(phrase, words)
    ]


def test_words_name_quantities():
    """In docstrings, in messages and on pages; rows of tables have the words of their results."""
    found = [
        sentence
        for name, tree in parsed().items()
        for line, text in texts_of(tree)
        for sentence in banned_in(f"condyn_pin/{name}:{line}", text)
    ]
    assert not found, "\n".join(found)


def prose_of(text: str) -> list[str]:
    """Paragraphs and headings of a page, without blocks of code, formulas and rows of tables."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!-- (\w+)[\w-]*:begin.*?:end -->", "", text, flags=re.DOTALL)
    rows = ("|", "$$")
    return re.split(
        r"\n\s*\n|\n(?=#|- |\d+\. )",
        "\n".join(line for line in text.split("\n") if not line.startswith(rows)),
    )


def test_pages_name_quantities():
    """Prose of README and docs; measured tables have the words of their results."""
    root = HOUSE.parent
    found = [
        sentence
        for page in (root / "README.md", *sorted((root / "docs").glob("*.md")))
        if (name := page.relative_to(root).as_posix()) not in APART
        for paragraph in prose_of(page.read_text("utf-8"))
        for sentence in banned_in(name, paragraph, BANNED_ON_PAGES)
    ]
    assert not found, "\n".join(found)


# One module knows which Pinocchio is installed


def names_in(tree: ast.Module) -> set[str]:
    """Return every name, attribute and import of a module; docstrings and comments are not."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            found |= {node.attr, ast.unparse(node)}
        elif isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.alias):
            found |= {node.name, f"import {node.name}"}
        elif isinstance(node, ast.ImportFrom):
            found.add(f"import {node.module}")
        elif isinstance(node, ast.Call) and not node.args and isinstance(node.func, ast.Attribute):
            found.add(f".{node.func.attr}()")
    return found


DIFFERS = {
    *("initConstraintDynamics", "residualSize", "corrector", "m_baumgarte_parameters"),
    *("contact_chol", "constraint_chol", "computeJointMinimalOrdering", "pin.lcaba"),
    *("getConstraintsJacobian", ".size()", "pin.__version__", "pinocchio.__version__"),
}
# What is wrong in Pinocchio: traps 12 and 13, and a copied Data, which works until it is used (22).
WRONG = {
    *("computeDelassusMatrix", "computeDampedDelassusMatrixInverse", "absolute_residual"),
    *("desired_contact_placement", "desired_contact_velocity", "desired_contact_acceleration"),
    *("impulseDynamics", "contactInverseDynamics", "getConstraintJacobian", "pin.Data"),
}


def test_one_module_knows_what_differs_between_versions_and_none_uses_what_is_wrong():
    """Pinocchio 3.9 and 4: other names, other arguments, other units of the same thing."""
    trees = parsed()
    nobody_needs = {"residualSize", ".size()", "getConstraintsJacobian", "pinocchio.__version__"}
    assert names_in(trees["_core/_pin.py"]) >= DIFFERS - nobody_needs
    for file, tree in trees.items():
        names = names_in(tree)
        assert not names & WRONG, file
        assert not {name for name in names if name.lower().endswith("data.copy")}, file
        if file != "study/mujoco/bridge.py":  # MuJoCo's model may be copied
            assert not names & {"deepcopy", "copy.copy"}, file
        if file != "_core/_pin.py":  # whose import explains how that of Pinocchio can fail
            assert not names & DIFFERS, file
            assert "import pinocchio" not in names, file
