"""Whatever is written to is whole or as it was, on a disk that fills up too."""

from __future__ import annotations

import errno
import json
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shared import each_row, robot
from shell import condyn
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin._core import files
from condyn_pin._core.files import atomic_write, check_writable, write_text
from condyn_pin._core.show import write_figure
from condyn_pin.study import fresh as plans
from condyn_pin.study.bench import bench
from condyn_pin.study.case import Results
from lab.cli import app as lab_app
from lab.extremes.report import write_csv as write_maps

pytestmark = pytest.mark.once


@pytest.fixture(scope="module")
def motion() -> cp.Trajectory:
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    return cp.simulate(scene, *scene.state(), duration=0.005)


@pytest.fixture(scope="module")
def batch() -> cp.simulation.BatchTrajectory:
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    q, v = scene.state()
    return cp.simulate_batch(scene, [q], [v], duration=0.005)


@pytest.fixture(scope="module")
def table() -> cp.study.Table:
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    return cp.Study([scene], [cp.DenseKKT()], states=1).run(timed=False)


@pytest.fixture(scope="module")
def writers(motion, batch, table) -> dict[str, Callable[[Path], Any]]:
    times = bench([])
    return {
        "motion.npz": motion.save,
        "motion.csv": motion.to_csv,
        "batch.npz": batch.save,
        "table.json": table.to_json,
        "table.csv": table.to_csv,
        "bench.json": times.to_json,
        "bench.csv": times.to_csv,
        "maps.csv": lambda path: write_maps([], path, "4.1.0"),
        "page.html": lambda path: cp.view(cp.model.pendulum(), html=path, browser=False),
    }


WRITERS = ("motion.npz", "motion.csv", "batch.npz", "table.json", "table.csv", "bench.json",
           "bench.csv", "maps.csv", "page.html")  # fmt: skip


GOOD = "pinocchio,family,robot,severity\n3.9.0,a,b,1\n"  # which `stress` goes on with


@pytest.fixture
def full_disk(monkeypatch):
    """Files that take a few bytes, and no more."""

    def no_space(new: Path, target: Path) -> None:
        new.write_bytes(b"half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "replace", no_space)


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_old_file(name, writers, tmp_path, full_disk):
    path = tmp_path / name
    path.write_text(GOOD, encoding="utf-8")
    with pytest.raises(cp.InvalidArgument, match=rf"{name}: cannot be written: No space left"):
        writers[name](path)
    assert path.read_text(encoding="utf-8") == GOOD
    assert os.listdir(tmp_path) == [name]


@pytest.mark.long
@each_row("name", WRITERS)
def test_folders_that_are_not_there_are_named(name, writers, tmp_path):
    with pytest.raises(cp.InvalidArgument, match=r"cannot be written: there is no folder .*no;"):
        writers[name](tmp_path / "no" / name)


@pytest.mark.long
def test_a_picture_without_an_ending_is_a_png(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    write_figure(Figure(figsize=(1, 1)), tmp_path / "a")
    write_figure(Figure(figsize=(1, 1)), tmp_path / "b.svg")
    assert sorted(os.listdir(tmp_path)) == ["a.png", "b.svg"]
    assert (tmp_path / "a.png").stat().st_size > 100, matplotlib.__version__


def test_what_stops_in_the_middle_leaves_nothing(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old", encoding="utf-8")

    def stopped() -> None:
        with atomic_write(path) as new:
            new.write_text("half", encoding="utf-8")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert path.read_text(encoding="utf-8") == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.long
def test_permissions_and_links_stay(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old", encoding="utf-8")
    path.chmod(0o640)
    link.symlink_to(path)
    write_text(link, "new")
    assert link.is_symlink()
    assert path.read_text(encoding="utf-8") == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    write_text(tmp_path / "b.txt", "new")
    (tmp_path / "c.txt").touch()
    modes = {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("b.txt", "c.txt")}
    assert len(modes) == 1


def test_what_is_no_file_is_written_to(tmp_path):
    write_text("/dev/null", "gone")
    check_writable("/dev/null")
    assert not Path("/dev/null").is_file()
    with pytest.raises(cp.InvalidArgument, match="cannot be written: Is a directory"):
        write_text(tmp_path, "x")


@pytest.mark.long
def test_looking_leaves_nothing(tmp_path):
    old = tmp_path / "old.txt"
    old.write_text("old", encoding="utf-8")
    for path in (old, tmp_path / "new.txt"):
        check_writable(path)
    assert os.listdir(tmp_path) == ["old.txt"]
    assert old.read_text(encoding="utf-8") == "old"


@pytest.mark.long
def test_nothing_is_written_in_another_way():
    """All of it opens files for writing in `files/`; results grow line by line."""
    words = ("write_text(encoding", ".write_bytes(", '.open("w', "np.save(", ".touch(")
    found = []
    for path in Path(cp.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        alone = text.replace('new.open("w', "").replace("self.touch(", "")  # what contacts did
        if "files" not in path.parts and any(word in alone for word in words):
            found.append(path.name)
        if "savefig(" in text and "savefig(new" not in text:
            found.append(path.name)
    assert not found
    assert files.__name__ == "condyn_pin._core.files"


def test_a_plan_without_a_place_is_refused_before_it_is_measured(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setattr("condyn_pin.study.study.choose", lambda *a, **k: pytest.fail("measured"))
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    with pytest.raises(cp.InvalidArgument, match=r"the plan cannot be saved.*XDG_CACHE_HOME"):
        cp.study.tune(scene)
    done = condyn("trade", "--tune", "four_bar")
    assert isinstance(done.exception, cp.InvalidArgument)


def test_results_that_no_longer_fit_are_named(table, tmp_path, monkeypatch):
    for path in (tmp_path, "/dev/zero"):
        with pytest.raises(cp.InvalidArgument, match=r"results = .*not a file"):
            Results(path)
    results = Results(tmp_path / "rows")
    results.keep("f", table.rows[0])

    def no_space(*args: Any, **kwargs: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "open", no_space)
    with pytest.raises(cp.InvalidArgument, match=r"rows': No space left.*what is in it stays"):
        results.keep("g", table.rows[0])
    monkeypatch.undo()
    assert Results(tmp_path / "rows").find("f", table.rows[0].key) == table.rows[0]


@pytest.mark.long
@each_row(
    ("key", "value"),
    [("error", "x"), ("parameters", 3), ("solver", None), ("where", []), ("found", -1)],
)
def test_plans_that_say_something_else_are_none(key, value, tmp_path):
    plan = {
        "fingerprint": "f" * 64, "measure": "acceleration", "error": 1e-8, "solver": "DenseKKT",
        "parameters": {}, "median_us": 1.0, "found": 0.0, "expected": 0.0, "states": 5, "where": {},
        "date": "today", "format": plans.FORMAT,
    }  # fmt: skip
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(plan), encoding="utf-8")
    assert plans.read_plan(path).solver == "DenseKKT"
    path.write_text(json.dumps(plan | {key: value}), encoding="utf-8")
    with pytest.raises(cp.InvalidArgument, match=f"not a plan .{key} = "):
        plans.read_plan(path)


@pytest.mark.long
def test_a_table_of_something_else_is_not_lost(tmp_path):
    """A stress run keeps the lines of other Pinocchios: it looks at the file first."""
    path = tmp_path / "mine.csv"
    for text in ("a,b\n1,2\n", "pinocchio\n3.9\n", "\xff" * 200_000):
        path.write_text(text, encoding="utf-16")
        done = CliRunner().invoke(lab_app, ["stress", "--csv", str(path)])
        assert isinstance(done.exception, cp.InvalidArgument), done.exception
        path.write_text(text, encoding="utf-8")
        if len(text) < 100:
            with pytest.raises(cp.InvalidArgument, match=r"mine\.csv: no table of `python"):
                write_maps([], path, "4.1.0")
            assert path.read_text(encoding="utf-8") == text


KILLED = """
import os, sys
from pathlib import Path
from condyn_pin._core.files import atomic_write
with atomic_write(sys.argv[1]) as new:
    new.write_text("half of it")
    print(os.listdir(Path(sys.argv[1]).parent), flush=True)
    os.kill(os.getpid(), 9)
"""


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="locks of files")
def test_what_a_killed_writer_leaves_goes_with_the_next(tmp_path):
    path = tmp_path / "a.txt"
    subprocess.run([sys.executable, "-c", KILLED, str(path)], capture_output=True, check=False)
    (left,) = tmp_path.iterdir()
    assert left.read_text() == "half of it"
    (tmp_path / ".condyn-notes").mkdir()  # somebody else's
    with atomic_write(path) as new, atomic_write(tmp_path / "b.txt") as other:
        assert not left.exists()
        assert new.exists()  # nobody removes what is being written
        new.write_text("one")
        other.write_text("two")
    assert path.read_text() == "one"
    assert sorted(os.listdir(tmp_path)) == [".condyn-notes", "a.txt", "b.txt"]
