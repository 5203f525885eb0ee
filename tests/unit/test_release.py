"""What a stranger gets: wheel and sdist, built from this tree, installed into an empty folder, and what they do."""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from support import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
TOP = ("README.md", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "CITATION.cff", "pyproject.toml")


def python(*words: str, at: Path, path: Path | None = None) -> str:
    """What Python prints in the folder ``at``; ``path``: before all other packages."""
    environment = os.environ | ({} if path is None else {"PYTHONPATH": str(path)})
    done = subprocess.run(
        [sys.executable, *words], cwd=at, env=environment, capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the sdist of this tree."""
    folder = tmp_path_factory.mktemp("release")
    python("-m", "pip", "install", "-q", "--target", str(folder / "tools"), *_build_requires(), at=folder)
    python("-m", "hatchling", "build", "-d", str(folder / "dist"), at=ROOT, path=folder / "tools")
    return folder / "dist"


def _build_requires() -> list[str]:
    requires: list[str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    return requires


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["*.whl", "*.tar.gz"])
def test_what_is_built_can_be_installed_and_used(kind: str, built: Path, tmp_path: Path) -> None:
    (file,) = built.glob(kind)
    python("-m", "pip", "install", "-q", "--no-deps", "--target", str(tmp_path / "lib"), str(file), at=tmp_path)
    asked = "import wakeflow; print(wakeflow.__file__, wakeflow.__version__)"
    home, version = python("-c", asked, at=tmp_path, path=tmp_path / "lib").split()
    assert (Path(home).parents[1], version) == (tmp_path / "lib", PROJECT["version"])
    cli = ["-m", "wakeflow.cli"]
    for template in ("vacuum", "rhombus"):
        python(*cli, "new", template, f"{template}.toml", at=tmp_path, path=tmp_path / "lib")
        assert "machine " in python(*cli, "plan", f"{template}.toml", at=tmp_path, path=tmp_path / "lib")


@pytest.mark.slow
def test_the_sdist_holds_what_a_stranger_looks_for(built: Path) -> None:
    (file,) = built.glob("*.tar.gz")
    with tarfile.open(file) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert names >= {*TOP, "tests/run.sh", "cases/run.sh", "docs/tutorial.md"}
    assert not [name for name in names if name.startswith(("runs/", ".venv/"))]


def test_every_file_names_the_same_version() -> None:
    version = PROJECT["version"]
    assert re.search(rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n{PROJECT['name']}=={version}  # " in (ROOT / "requirements.lock").read_text()


def test_the_workflow_runs_the_two_commands_of_the_readme() -> None:
    runs = re.findall(r"^      - run: (sh .*)$", (ROOT / ".github" / "workflows" / "test.yml").read_text(), re.M)
    readme = (ROOT / "README.md").read_text()
    assert runs == re.findall(r"^(sh (?:cases|tests)/run\.sh)", readme, re.M)[:2]
