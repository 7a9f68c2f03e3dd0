"""The same everywhere: one thread for the linear algebra, a plain terminal, the same examples.

Tests marked `chromium` look at what a browser draws. Without one they are left out, and the end of
the run says so; where CI=true they fail. Tests marked `native` use the compiled core, and are left
out where it is not installed, but for those to which it is optional; with `-m native` they fail.
Tests marked `once` run on Pinocchio 4 alone. Those of `QUICK` are marked `quick`, for a first look
at a change in under a minute. Those marked `long`, and of those marked `pairs` or `values` all but
few cases of the product, are left out without `--long`; the end of the run says how many.
"""

import os
import re
import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

# Judges and random machines are benchmarks, too.
sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))

# Before numpy: what tests compute themselves waits for no other core. kernels.py leaves it out.
if os.environ.get("TEST_THREADS") != "unset":
    os.environ.setdefault("OMP_NUM_THREADS", "1")

# Tests are of Python also where the core is installed; those marked `native` name the core.
os.environ.setdefault("CONDYN_ENGINE", "python")

import pytest
from hypothesis import HealthCheck, settings
from pairwise import cover

# Pages are as wide and as plain as they are without a terminal, and no window opens.
_COLOURS = ("FORCE_COLOR", "CLICOLOR_FORCE", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
for _name in ("COLUMNS", "TERMINAL_WIDTH", "DISPLAY", "WAYLAND_DISPLAY", *_COLOURS):
    os.environ.pop(_name, None)
os.environ |= {"MPLBACKEND": "agg", "no_proxy": "127.0.0.1"}

# The examples are the same every time, and nobody looks at the clock: machines may be slow.
# pytest --hypothesis-profile=search looks for new ones.
_slow = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, **_slow)
settings.register_profile("search", max_examples=1000, **_slow)
settings.load_profile("same")


_LEFT_OUT = pytest.StashKey[int]()
_NO_CHROMIUM = "there is no Chromium"
_NO_CORE = "the compiled core is not installed"
_CURES = {
    _NO_CHROMIUM: "apt-get install chromium, or brew install --cask chromium",
    _NO_CORE: "make native",
}

# Most rooms once, in under a minute: of each file the tests whose names match, by default all.
QUICK = {
    "test_package.py": "^test_(?!without)",
    "test_constraints.py": "",
    "test_new_kind.py": "",
    "test_equations.py": "cassie|four_bar|solo12",
    "test_scene.py": "^(?!.*(hands|costs|guesses))",
    "test_solution.py": "",
    "test_contract.py": "four_bar loops|solo12 contacts",
    "test_derivatives.py": "four_bar|by_hand|refuses",
    "test_assembly.py": "dead_point|beyond|bad_input|mirror",
    "test_cones.py": "^test_(?!a_wrench_is_inside)",
    "test_contact_solvers.py": "test_contract",
    "test_steppers.py": "slides|sticks|rebounds|refused|stands|loops",
    "test_step_derivatives_batch.py": "^test_(?!processes)",
    "test_routes.py": "closed|by_hand|refused",
    "test_simulate.py": "pendulum|fall|spring|samples|energy|refused|notice",
    "test_events.py": "^test_(?!two_feet|a_contact_that_pulls)",
    "test_transmission.py": "",
    "test_operational.py": "",
    "test_control_by_hand.py": "",
    "test_control_mistakes.py": "",
    "test_robot.py": "",
    "test_srdf.py": "^test_(?!spoilt)",
    "test_plots.py": "violation|overview|names",
    "test_trade.py": "cheapest",
    "test_cli.py": "json_of_the_answers|mistake",
}


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="long tests too, and whole products")


def pytest_configure(config):
    config.addinivalue_line("markers", "chromium: looks at what a browser draws")
    config.addinivalue_line("markers", "once: Pinocchio has no part in it, one version will do")
    config.addinivalue_line("markers", "quick: most rooms once, in under a minute")
    config.addinivalue_line("markers", "native(optional=False): uses the compiled core")
    config.addinivalue_line("markers", "long: with --long alone, before a release")
    config.addinivalue_line("markers", "pairs: of any two parameters every pair; all with --long")
    config.addinivalue_line("markers", "values: of each parameter every value; all with --long")


def pytest_ignore_collect(collection_path, config):
    """Files without a quick test are not read where only these are asked for."""
    others = collection_path.suffix == ".py" and collection_path.name not in QUICK
    return True if config.option.markexpr == "quick" and others else None


@pytest.hookimpl(tryfirst=True)  # before -m chooses by markers
def pytest_collection_modifyitems(config, items):
    for item in items:
        if _of_compiled_solver(item):
            item.add_marker(pytest.mark.native)
        if re.search(QUICK.get(item.path.name, "$^"), item.name):
            item.add_marker(pytest.mark.quick)
    if not config.option.long and not any("[" in arg for arg in config.args):  # a case by its name
        _deselect_long(config, items)
    if not _has_chromium() and os.environ.get("CI") != "true":  # there they fail
        _skip(items, "chromium", _NO_CHROMIUM)
    if not _has_core() and "native" not in config.option.markexpr:  # chosen, they fail
        _skip(items, "native", _NO_CORE)


def _deselect_long(config, items):
    products = defaultdict(lambda: defaultdict(list))  # of each function, its cases by their values
    left_out = {item for item in items if item.get_closest_marker("long")}
    for item in items:
        for together, marker in enumerate(("values", "pairs"), 1):
            if item.get_closest_marker(marker) and item not in left_out:
                values = tuple(map(id, item.callspec.params.values()))
                products[item.function, together][values].append(item)
    for (_, together), cases in products.items():
        for values in cases.keys() - cover([*cases], together):
            left_out.update(cases[values])
    config.stash[_LEFT_OUT] = len(left_out)
    if hasattr(config, "workeroutput"):  # of xdist: they go to the process that writes the summary
        config.workeroutput["left out"] = len(left_out)
    config.hook.pytest_deselected(items=[item for item in items if item in left_out])
    items[:] = [item for item in items if item not in left_out]


def _of_compiled_solver(item):
    """Whether a test has a parameter that is a solver of the compiled core, or its name."""
    from condyn_pin.dynamics import PV, ConstrainedABA

    given = item.callspec.params.values() if hasattr(item, "callspec") else ()
    names = "constrainedaba", "pv"
    return any(
        x in names if isinstance(x, str) else isinstance(x, ConstrainedABA | PV) for x in given
    )


def _has_chromium():
    from condyn_pin.errors import MissingExtra
    from condyn_pin.viewing.viewer import find_chromium

    try:
        find_chromium()
    except MissingExtra:
        return False
    return True


def _has_core():
    from condyn_pin._core.compiled import compiled, compiled_tick, constrained_aba
    from condyn_pin.errors import MissingExtra

    try:
        compiled(), compiled_tick(), constrained_aba()
    except MissingExtra:
        return False
    return True


def _skip(items, name, reason):
    for item in items:
        marker = item.get_closest_marker(name)
        if marker and not marker.kwargs.get("optional"):
            item.add_marker(pytest.mark.skip(reason=reason))


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    node.config.stash[_LEFT_OUT] = getattr(node, "workeroutput", {}).get("left out", 0)


def pytest_terminal_summary(terminalreporter):
    if count := terminalreporter.config.stash.get(_LEFT_OUT, 0):
        terminalreporter.write_line(f"{count} long tests were left out: pytest --long has them")
    skipped = terminalreporter.stats.get("skipped", [])
    for reason, cure in _CURES.items():
        count = sum(reason in str(report.longrepr) for report in skipped)
        if count:
            terminalreporter.write_line(f"{count} tests were left out, since {reason}: {cure}")


@pytest.fixture(autouse=True)
def seeded():
    """Let Pinocchio's random numbers not depend on the tests that ran before."""
    from condyn_pin._core._pin import pin

    pin.seed(0)


@dataclass(frozen=True)
class Engine:
    """Python or the compiled core, and how a verb is told: `executor` of batches, or `engine`."""

    native: bool

    @property
    def name(self):
        return "core" if self.native else "python"

    @property
    def batches(self):
        import condyn_pin as cp

        return {"executor": cp.Native(threads=1)} if self.native else {}


@pytest.fixture(
    params=[
        pytest.param(False, id="Python"),
        pytest.param(True, id="core", marks=pytest.mark.native),
    ]
)
def engine(request):
    """Each of two engines: a test that has it says the same of both."""
    return Engine(request.param)


@pytest.fixture
def read(tmp_path):
    """Read an SDF model given as text."""
    from condyn_pin.io.sdf import read_sdf

    def read_text(body: str, version: str = "1.9", **options):
        path = tmp_path / "robot.sdf"
        path.write_text(f'<sdf version="{version}"><model name="robot">{body}</model></sdf>')
        return read_sdf(path, **options)

    return read_text
