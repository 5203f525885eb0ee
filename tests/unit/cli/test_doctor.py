"""The doctor: tries what a run does, names the command for what fails, survives what crashes."""

import io
import re
import shutil
import sys
import tomllib
from functools import partial
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from support import ROOT
from wakeflow.core.errors import MeshError
from wakeflow.extras.doctor import examination as doctor
from wakeflow.extras.doctor.examination import Finding, exit_code


@pytest.mark.openfoam
def test_this_machine_does_in_small_what_a_run_does() -> None:
    found = {finding.name: finding for finding in doctor.examine()}
    assert found["Python"].ok
    assert found["numpy"] == Finding("numpy", version("numpy"), True, "every run")
    assert found["tornado"].optional
    for name, told in (
        ("a mesh", "Gmsh 4"),
        ("an airflow", "OpenFOAM "),
        ("a flight", "numba 0"),
        ("a picture", "Mat"),
    ):
        assert found[name].ok, found[name]
        assert (found[name].version or "").startswith(told)
    assert {*doctor.TRIALS, "cores", "memory", "disk", "cache"} < {*found}
    for finding in found.values():
        assert finding.ok == (finding.mend == "") or finding.optional, finding
        assert finding.needed_for


def test_every_dependency_but_those_of_the_tests_is_looked_at() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    lists = {"": project["dependencies"], **{extra: extras[extra] for extra in extras if extra != "test"}}
    wanted = {
        (Requirement(line).name, str(Requirement(line).specifier), extra) for extra in lists for line in lists[extra]
    }
    assert {(asked.name, str(asked.specifier), extra) for asked, extra in doctor._required()} == wanted


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


def test_a_missing_package_and_one_too_old() -> None:
    mend = f"{sys.executable} -m pip install "
    assert doctor._package(Requirement("no-such-package>=1"), "some") == Finding(
        "no-such-package", None, False, "the extra some", f"{mend}'no-such-package>=1'", optional=True
    )
    assert doctor._package(Requirement("numpy>=999")) == Finding(
        "numpy", f"{version('numpy')} (needs >=999)", False, "every run", f"{mend}'numpy>=999'"
    )


def test_a_mesh_that_fails_names_what_gmsh_links_to(monkeypatch: pytest.MonkeyPatch) -> None:
    said = "OSError: libXcursor.so.1: cannot open shared object file: No such file or directory"

    def fail(*_: object, **__: object) -> None:
        raise MeshError("python failed with exit code 1; log: x", tail=f"Traceback\n{said}\n", ended="failed")

    monkeypatch.setattr("wakeflow.air.mesh.spec.call_in_child", fail)
    for found in map(doctor._tried, ("a mesh", "an airflow")):
        assert (found.ok, found.version) == (False, said)
        assert re.match(r"apt-get install .*libxcursor1 .*# or.* -m pip install --force-reinstall gmsh", found.mend)


@pytest.mark.openfoam
@pytest.mark.parametrize(
    ("script", "told", "mend"),
    [
        (None, "program 'simpleFoam' is not installed", "apt-get install --no-install-recommends openfoam"),
        (
            """printf '\\n--> FOAM FATAL IO ERROR: \\nerror in IOstream "sha1"\\n\\n'; exit 1""",
            'simpleFoam stopped: error in IOstream "sha1"',
            "apt-get install tcc",
        ),
        ("kill -SEGV $$", "simpleFoam crashed (signal 11)", "--reinstall openfoam"),
        ("exit 0", "simpleFoam ended at 0 without a step", "--reinstall openfoam"),
    ],
)
def test_an_airflow_that_fails_names_what_mends_it(
    script: str | None, told: str, mend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gmsh meshes, gmshToFoam and checkMesh do their part; simpleFoam is missing, or ends as ``script`` does; there is
    no C compiler.
    """
    for name in ("gmshToFoam", "checkMesh"):
        (tmp_path / name).symlink_to(shutil.which(name) or name)
    if script is not None:
        (tmp_path / "simpleFoam").write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / "simpleFoam").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("wakeflow.air.foam.programs.kernel_root", lambda: tmp_path)
    found = doctor._tried("an airflow")
    assert (found.ok, found.version) == (False, told)
    assert found.mend.endswith(mend)


def test_what_kills_the_interpreter_is_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, code in (("a picture in 3D", "import os; os.abort()"), ("a picture", "import no_such_library")):
        said = partial(doctor._says, [sys.executable, "-c", code])
        monkeypatch.setitem(doctor.TRIALS, name, doctor.TRIALS[name]._replace(work=said))
    found = doctor._tried("a picture in 3D")
    assert (found.ok, found.optional) == (False, True)
    assert "failed with exit code -6" in (found.version or "")
    assert "libegl1" in found.mend
    found = doctor._tried("a picture")
    assert (found.ok, found.version) == (False, "ModuleNotFoundError: No module named 'no_such_library'")
    assert found.mend.endswith("-m pip install --force-reinstall matplotlib")


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
