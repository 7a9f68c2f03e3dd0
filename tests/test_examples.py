"""Every example runs as it is, fits two screens, and ends by printing its own error."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from condyn_pin.control import ProxQP
from condyn_pin.control.qp.qp_solver import QPResult

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))

# Long loops around calls that shorter examples make too.
LONG = (
    "12_many_states", "19_talos_is_pushed", "21_identify_friction", "22_swing_by_ilqr",
    "24_weigh_by_pushing", "30_vakonomic_sleigh", "31_steer_by_sinusoids",
)  # fmt: skip


def test_there_are_examples():
    assert len(EXAMPLES) >= 10


def test_the_documentation_lists_them_all():
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `examples/(\w+)\.py`", page, re.MULTILINE) == [p.stem for p in EXAMPLES]


def test_a_preview_that_is_not_solved_says_so(monkeypatch):
    preview = runpy.run_path(str(ROOT / "examples" / "20_mpc_over_wbc.py"))["preview"]
    still, way, far = np.zeros((3, 2)), np.zeros((16, 2)), np.array([0.1, 0.1])
    assert np.allclose(preview(0.25, -far, far)(still, way), 0.0)
    with pytest.raises(AssertionError, match="no way keeps the ZMP on the feet: failed"):
        preview(0.25, -far, far)(still * np.nan, way)
    none = QPResult(np.zeros(16), np.zeros(16), "infeasible", 1)
    monkeypatch.setattr(ProxQP, "start", lambda _: lambda _: none)
    with pytest.raises(AssertionError, match="no way keeps the ZMP on the feet: infeasible"):
        preview(0.25, -far, far)(still, way)


def marked(path: Path) -> object:
    marks = pytest.mark.long if path.stem in LONG else ()
    return pytest.param(path, marks=marks, id=path.stem)


def test_long_ones_are_examples():
    assert {path.stem for path in EXAMPLES} >= {*LONG}


@pytest.mark.parametrize("path", [marked(path) for path in EXAMPLES])
def test_example(path, monkeypatch, capsys):
    """In this process, which has imported what all of them need."""
    assert len(path.read_text().splitlines()) <= 80
    monkeypatch.setattr(sys, "argv", [str(path), "--no-view", "--quick"])
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.chdir(ROOT)
    runpy.run_path(str(path), run_name="__main__")
    last = capsys.readouterr().out.splitlines()[-1]
    assert "error" in last
    value = re.search(r"error.*?(\d\S*)", last)
    assert value
    assert float(value.group(1)) < 1e-8
