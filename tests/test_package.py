"""The package itself: names, lightness, version differences in one place."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import condyn_pin as cp

PACKAGE = Path(cp.__file__).parent


def test_the_stub_lists_public_names_and_nothing_else():
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    *imports, version = stub.body
    assert ast.unparse(version) == "__version__: str"
    for line in imports:
        assert isinstance(line, ast.ImportFrom)
        assert line.module.startswith("condyn_pin.")
        # without "as" a type checker takes it for the stub's own
        assert all(alias.asname == alias.name for alias in line.names), line.module
    names = [alias.name for line in imports for alias in line.names]
    assert cp.__all__ == sorted(set(names))
    assert len(names) == len(cp.__all__)


@pytest.mark.parametrize("name", cp.__all__)
def test_every_public_name_exists_and_is_documented(name):
    value = getattr(cp, name)
    assert name in dir(cp)
    assert isinstance(value, dict) or value.__doc__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = cp.nothing


def modules_after(code: str) -> set[str]:
    program = f"{code}\nimport sys; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return {name.split(".")[0] for name in result.stdout.split()}


def test_import_stays_light():
    assert modules_after("import condyn_pin") & {"pinocchio", "numpy", "scipy", "typer"} == set()


def test_using_it_imports_only_what_it_needs():
    code = """
import condyn_pin as cp
bar = cp.four_bar()
scene = cp.Scene(bar, bar.loops)
cp.Workspace
"""
    heavy = {"matplotlib", "meshcat", "typer", "rich", "mujoco", "hypothesis"}
    assert modules_after(code) & heavy == set()


def test_nothing_in_the_library_prints():
    for path in PACKAGE.rglob("*.py"):
        calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        assert not [c for c in calls if getattr(c.func, "id", "") == "print"], path


def test_marker_for_type_checkers_is_there():
    assert (PACKAGE / "py.typed").is_file()


def test_nothing_relies_on_a_wider_long_double():
    for path in PACKAGE.rglob("*.py"):
        assert "longdouble" not in path.read_text().replace("long double", ""), path


def test_contributing_says_where_everything_is():
    text = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text.partition("## Where things are")[2].partition("\n## ")[0]
    first = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    said = re.findall(r"`([\w/]+(?:\.py|/))`", "".join(first))
    there = [path.name for path in PACKAGE.glob("*.py")]
    there += [f"{path.parent.relative_to(PACKAGE)}/" for path in PACKAGE.glob("*/**/__init__.py")]
    assert set(there) - set(said) == {"__init__.py"}
    assert all((PACKAGE / each).exists() for each in said)
