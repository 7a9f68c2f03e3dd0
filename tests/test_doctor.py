"""Installations that do not fit together, and the line that repairs each."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace

import pytest

from condyn_pin._core import compiled, doctor

ROOT = Path(__file__).parent.parent


def install(monkeypatch, **versions):
    named = {name.replace("_", "-"): version for name, version in versions.items()}
    monkeypatch.setattr(doctor, "installed_version", named.get)


@pytest.mark.parametrize(
    ("versions", "finding", "remedy"),
    [
        ({"pin": "4.1.0", "libpinocchio": "4.1.0"}, "", ""),
        ({"pin": "3.9.0", "libpinocchio": "3.9.0", "cmeel_urdfdom": "4.0.1"}, "", ""),
        ({"pin": "3.9.0", "cmeel_urdfdom": "6.0.0"}, "cmeel-urdfdom 6.0.0", doctor.MEND_3),
        ({"pin": "3.9.0", "cmeel_tinyxml2": "11.0.0"}, "must be <11", doctor.MEND_3),
        ({"pin": "4.1.0", "libpinocchio": "4.0.0"}, "the same version", doctor.MEND_4),
        ({"pinocchio": "0.4.3"}, "test plugin", doctor.REPLACE_NAMESAKE),
    ],
)
def test_mixed_installs_are_found(monkeypatch, versions, finding, remedy):
    install(monkeypatch, **versions)
    findings, mend = doctor.mixed_install()
    assert mend == remedy
    assert finding in "; ".join(findings)
    assert bool(findings) == bool(finding)


def test_a_pinocchio_from_elsewhere_is_found(monkeypatch):
    install(monkeypatch)
    findings, remedy = doctor.mixed_install()
    assert "do not mix package managers" in findings[0]
    assert ".venv" in remedy


def in_a_process_whose_pinocchio_fails(folder, code: str) -> subprocess.CompletedProcess[str]:
    """Put a package of that name in front, which fails as the mismatched wheel does."""
    (folder / "pinocchio").mkdir()
    failure = "liburdfdom_sensor.so.4.0: cannot open shared object file"
    (folder / "pinocchio" / "__init__.py").write_text(f"raise ImportError({failure!r})")
    program = f"import sys; sys.path.insert(0, {str(folder)!r})\n" + textwrap.dedent(code)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)


@pytest.mark.long
def test_import_error_names_the_exact_line(tmp_path):
    result = in_a_process_whose_pinocchio_fails(
        tmp_path, "import condyn_pin; condyn_pin.load_robot"
    )
    assert result.returncode == 1
    assert "BrokenPinocchio" in result.stderr
    assert "liburdfdom_sensor" in result.stderr
    assert "python -m pip install" in result.stderr


def test_the_package_and_the_doctor_work_without_pinocchio(tmp_path):
    result = in_a_process_whose_pinocchio_fails(
        tmp_path,
        """
        import condyn_pin
        from condyn_pin._core import doctor
        print(condyn_pin.__version__, doctor.advise(ImportError("x")))
        """,
    )
    assert result.returncode == 0, result.stderr
    assert "This repairs it: python -m pip install" in result.stdout


@pytest.mark.long
def test_condyn_doctor_runs_without_pinocchio(tmp_path):
    code = (
        "import sys; sys.argv = ['condyn', 'doctor']; from condyn_pin.cli.main import main; main()"
    )
    probe = f"import os; os.environ['PYTHONPATH'] = {str(tmp_path)!r} + ':' + {str(ROOT)!r}\n"
    result = in_a_process_whose_pinocchio_fails(tmp_path, probe + code)
    assert result.returncode == 1, result.stderr
    assert "liburdfdom_sensor" in result.stdout
    assert "python -m pip install" in result.stdout


def test_diagnosis_of_a_broken_installation(monkeypatch):
    """The probe runs in another process; here it is one that fails."""
    real = subprocess.run

    def fail(command, **options):
        return real([command[0], "-c", "raise ImportError('no such library')"], **options)

    monkeypatch.setattr(doctor.subprocess, "run", fail)
    found = doctor.diagnose()
    assert not found.imports
    assert "no such library" in found.findings[0]
    assert found.remedy.startswith("python -m pip install")


@pytest.mark.long
@pytest.mark.parametrize("version", ["3.8.0", "5.0.0"])
def test_a_version_that_is_not_supported_is_a_finding(version):
    code = f"""
import pinocchio
pinocchio.__version__ = {version!r}
from condyn_pin._core.doctor import diagnose
found = diagnose()
print(found.findings[0])
print(found.remedy)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert f"Pinocchio {version} is installed; 3.9 or 4.x is needed" in result.stdout
    assert "pip install" in result.stdout.splitlines()[1]


COMPILED = {
    "compiled core": "_core",
    "compiled control ticks": "_tick",
    "ConstrainedABA, PV": "_constrained_aba",
}


@pytest.mark.parametrize(
    "missing", [(), ("_tick",), ("_constrained_aba",), tuple(COMPILED.values())]
)
def test_what_is_compiled_is_told_apart(monkeypatch, missing):
    """Each may be missing where the others are there."""

    def imported(name):
        module = name.rpartition(".")[2]
        if module in missing or (module == "condyn_pin_native" and len(missing) == len(COMPILED)):
            raise ImportError(f"no module named {name}")
        protocol = compiled.TICK_PROTOCOL if module == "_tick" else compiled.PROTOCOL
        return SimpleNamespace(protocol=protocol, arch="", pinocchio="4.1.0", simd="SSE2")

    for name in ("compiled", "compiled_tick", "constrained_aba", "missing_constrained_aba"):
        monkeypatch.setattr(compiled, name, getattr(compiled, name).__wrapped__)
    monkeypatch.setattr(compiled, "import_module", imported)
    said = compiled.core_features()
    if len(missing) == len(COMPILED):  # one sentence for all
        (text,) = said.values()
        assert text.startswith("no, and so no control ticks, no ConstrainedABA, no PV: pip install")
        return
    assert said.keys() == COMPILED.keys()
    for name, module in COMPILED.items():
        assert said[name].startswith("no: " if module in missing else "yes, ")
        assert ("pip install ./native" in said[name]) == (module in missing)
