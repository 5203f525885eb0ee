"""The doctor: finds what is there, names the command for what is not, survives what crashes."""

import io
import os
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

from support import ROOT
from wakeflow.cli import doctor
from wakeflow.cli.doctor import Finding, exit_code


def test_this_machine_is_examined() -> None:
    found = {finding.name: finding for finding in doctor.examine()}
    assert found["Python"].ok
    assert found["numpy"] == Finding("numpy", version("numpy"), True, "arrays")
    assert {*doctor.PACKAGES, *doctor.PROGRAMS, "VTK's OpenGL", "setpriv", "cores", "memory", "disk", "cache"} < {
        *found
    }
    for finding in found.values():
        assert finding.ok == (finding.mend == "") or finding.optional, finding
        assert finding.needed_for


def test_every_dependency_is_looked_at() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    wanted = {line.split(">")[0]: set(line[line.index(">") :].split(",")) for line in listed}
    assert sorted(wanted) == sorted(doctor.PACKAGES)
    assert {name: set(str(bounds).split(",")) for name, bounds in doctor._bounds().items()} == wanted


def test_what_is_needed_decides_the_exit_code() -> None:
    there = Finding("a", "1", True, "all")
    lacking = Finding("b", None, False, "all", "mend it")
    optional = Finding("c", None, False, "some", "mend it", optional=True)
    assert exit_code([there, optional]) == 0
    assert exit_code([there, optional, lacking]) == 3


def test_the_table_shows_the_command() -> None:
    from rich.console import Console

    console = Console(width=120, record=True, file=io.StringIO())
    console.print(doctor.table([Finding("b[old]", None, False, "all", "apt-get install b")]))
    text = console.export_text()
    assert "✗" in text
    assert "b[old]" in text  # no markup
    assert "apt-get install b" in text


def test_a_missing_package_and_one_too_old(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor._package("no-such-package", "nothing") == Finding(
        "no-such-package", None, False, "nothing", "sh cases/setup.sh"
    )
    monkeypatch.setattr(doctor, "_bounds", lambda: {"numpy": SpecifierSet(">=999")})
    found = doctor._package("numpy", "arrays")
    assert not found.ok
    assert "needs >=999" in (found.version or "")
    assert "pip install 'numpy>=999'" in found.mend


def test_a_missing_library_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    message = "libXcursor.so.1: cannot open shared object file: No such file or directory"
    monkeypatch.setattr(doctor, "_GMSH", f"raise OSError({message!r})")
    found = doctor._gmsh_starts()
    assert not found.ok
    assert found.mend.startswith("apt-get install libxcursor1 ")


def test_a_missing_program_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    found = doctor._program("simpleFoam", "steady airflow")
    assert (found.version, found.ok) == (None, False)
    assert "sh cases/setup.sh" in found.mend


@pytest.mark.parametrize(
    ("script", "ok", "told"),
    [
        (
            'test "$WM_PROJECT_DIR" = /usr/share/openfoam && echo "Using: OpenFOAM- (1912) - visit" "patch=200626"',
            True,
            "1912.200626",
        ),
        ("echo 'Could not find mandatory etc entry'; exit 1", False, "Could not find mandatory etc entry"),
        ("kill -SEGV $$", False, "exit code -11"),
        ("echo 'Using: OpenFOAM- (1912)'; echo cannot go on; exit 1", False, "cannot go on"),
    ],
)
def test_a_program_is_started_and_asked(
    script: str, ok: bool, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "simpleFoam"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.delenv("WM_PROJECT_DIR", raising=False)
    found = doctor._program("simpleFoam", "steady airflow")
    assert (found.ok, found.version) == (ok, told)
    assert (found.mend == "") is ok


def test_graphics_that_kill_the_interpreter_are_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_RENDER", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    found = doctor._graphics()
    assert (found.ok, found.optional, found.version) == (False, True, "ended by signal 11")
    assert "libegl1" in found.mend


def test_a_cache_that_cannot_be_written_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WAKEFLOW_CACHE", "/proc/wakeflow")
    found = doctor._cache()
    assert not found.ok
    assert found.mend.startswith("export WAKEFLOW_CACHE=")


def test_looking_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "deep" / "cache"))
    assert doctor._cache().ok
    assert doctor._disk().ok
    assert list(tmp_path.iterdir()) == []


def test_a_small_machine_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_memory_limits", lambda: iter([8e9, 0.5e9]))
    found = doctor._memory()
    assert (found.version, found.ok) == ("0.5 GB", False)
