"""Which test files are left out: those whose reading is as it was when they passed, and no other."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import unchanged
from support import ROOT

TESTS = ROOT / "tests"


def _read(file: str) -> set[str]:
    return {path.relative_to(ROOT).as_posix() for path in unchanged.paths_of(TESTS / file)}


def test_a_test_reads_what_it_imports_and_what_that_runs() -> None:
    read = _read("unit/laws/test_gas.py")
    assert {"tests/unit/laws/test_gas.py", "tests/conftest.py"} <= read
    assert {"src/wakeflow/laws/gas.py", "cases/rhombus.toml"} <= read
    assert "src/wakeflow/laws/materials.toml" in read
    assert not [path for path in read if path.startswith(("src/wakeflow/extras/page", "docs/"))]


@pytest.mark.parametrize("file", ["unit/test_docs.py", "unit/test_architecture.py", "unit/answer/test_result.py"])
def test_a_test_that_looks_at_all_reads_all(file: str) -> None:
    every = {path.relative_to(ROOT).as_posix() for path in (ROOT / "src" / "wakeflow").rglob("*.py")}
    assert every | {"docs/model.md", "README.md", "pyproject.toml"} <= _read(file)


def test_every_file_reads_itself_and_modules_of_the_package() -> None:
    for file in sorted(TESTS.rglob("test_*.py")):
        read = unchanged.paths_of(file)
        assert file in read
        assert any(path.is_relative_to(ROOT / "src") for path in read), file


TEST = "def test_{}():\n    assert open('tests/one/data.txt').read() == 'good'\n"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A checkout of two test files, one beside data, whose package is this one."""
    (tmp_path / "tests" / "one").mkdir(parents=True)
    for name in ("conftest.py", "unchanged.py"):
        (tmp_path / "tests" / name).write_text((TESTS / name).read_text())
    for name in ("cases", "src", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "tests" / "one" / "data.txt").write_text("good")
    (tmp_path / "tests" / "one" / "test_a.py").write_text(TEST.format("a"))
    (tmp_path / "tests" / "test_b.py").write_text("import helper\n\n\ndef test_b():\n    assert helper.NUMBER == 1\n")
    (tmp_path / "tests" / "helper.py").write_text("NUMBER = 1\n")
    settings = 'pythonpath = ["tests"]\nmarkers = ["slow: x"]\n'
    (tmp_path / "pyproject.toml").write_text(f"[tool.pytest.ini_options]\n{settings}")
    return tmp_path


def _ran(tree: Path, *options: str) -> str:
    """The last lines of a session in the tree, which keeps what passed beside it."""
    own = {"WAKEFLOW_TEST_CACHE": str(tree / "kept"), "PYTHONPATH": str(tree / "src")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests", *options], cwd=tree, text=True,
        capture_output=True, check=False, env=os.environ | own,
    )  # fmt: skip
    return f"{done.returncode} {' '.join(done.stdout.splitlines()[-3:])}"


def test_what_passed_is_left_out_until_something_that_it_reads_changes(tree: Path) -> None:
    assert "2 passed" in _ran(tree)
    nothing = _ran(tree)
    assert nothing.startswith("0 ")
    assert "2 test files are as they were" in nothing
    assert "2 passed" in _ran(tree, "--all")
    (tree / "tests" / "one" / "data.txt").write_text("bad")
    for _ in range(2):  # what failed is noted by no session
        assert "1 failed" in _ran(tree)
    (tree / "tests" / "one" / "data.txt").write_text("good")
    (tree / "tests" / "helper.py").write_text("NUMBER = 1  # changed\n")
    assert "1 passed" in _ran(tree, "-k", "test_b")  # a part of a session notes nothing
    assert "1 passed" in _ran(tree)
    assert _ran(tree).startswith("0 ")
