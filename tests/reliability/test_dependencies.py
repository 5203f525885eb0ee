"""What set-up installs: versions within the bounds of pyproject.toml, under licences that the program's own allows."""

import os
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import dependencies
from support import ROOT


def locked() -> dict[str, tuple[str, ...]]:
    """Of each package its version and licence."""
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    return {name: tuple(rest.split("  # ")) for name, rest in (line.split("==") for line in lines if line[0] != "#")}


def test_the_lock_holds_every_dependency_within_its_bounds() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for text in [*project["dependencies"], *project["optional-dependencies"]["test"]]:
        asked = Requirement(text)
        if asked.name != "wakeflow":
            assert asked.specifier.contains(locked()[canonicalize_name(asked.name)][0], prereleases=True), text


def test_every_licence_is_listed_and_may_be_passed_on_with_the_program() -> None:
    for name, made in dependencies.needed().items():
        licence = dependencies.licence_of(made)
        assert dependencies.COMPATIBLE.search(licence), f"{name}: {licence}"
    assert not [name for name, (_, licence) in locked().items() if not dependencies.COMPATIBLE.search(licence)]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_wheel_runs_elsewhere_without_openfoam(tmp_path: Path) -> None:
    """In an environment of its own, which takes the dependencies from this one; no program but Python is found."""
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    pip = [python, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", tmp_path / "dist", ROOT], check=True)
    subprocess.run([*pip, "install", "--no-deps", *(tmp_path / "dist").glob("*.whl")], check=True)
    (there,) = (tmp_path / "venv").glob("lib/python3*/site-packages")
    (there / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "WAKEFLOW_CACHE")}

    def said(*words: str) -> tuple[int, str]:
        done = subprocess.run(
            [python, "-m", "wakeflow.cli", *words], cwd=tmp_path, capture_output=True, text=True, check=False,
            env=environment | {"PATH": str(python.parent), "WAKEFLOW_KERNELS": str(tmp_path / "kernels")},
        )  # fmt: skip
        assert "Traceback" not in done.stderr
        return done.returncode, done.stdout + done.stderr

    where = subprocess.run(
        [python, "-c", "import wakeflow; print(wakeflow.__file__)"], capture_output=True, cwd=tmp_path, env=environment
    )
    assert str(there) in where.stdout.decode()
    assert said("new", "vacuum", "my.toml")[0] == 0
    code, table = said("doctor")
    assert code == 3
    assert "openfoam" in table
    assert said("run", "my.toml", "--set", "feed.count=64")[0] == 0
    assert (tmp_path / "runs" / "my+feed.count=64" / "report.html").exists()
