"""Compiled kernels are kept by their sources alone: for copies of them, not for other ones, and never damaged."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wakeflow.core.code_key import PACKAGE, kernel_folder
from wakeflow.flight.kernel import jit

TRACKER = "wakeflow.flight.kernel.loop"
FOLDER = f"from wakeflow.core.code_key import kernel_folder; print(kernel_folder('{TRACKER}'))"
FLY = (
    "import numpy as np; from wakeflow.flight import Granules, track\n"
    "track(None, Granules(np.zeros((1, 2)), np.ones((1, 2)), diameter=1e-3, density=1.0), until=1.0)\n"
    "from wakeflow.flight.kernel.loop import fly_block as f\n"
    "print(sum(f.stats.cache_hits.values()), sum(f.stats.cache_misses.values()))"
)


def told(code: str, source: Path, **environment: str) -> str:
    """What a new process says with the package in ``source``."""
    command, path = [sys.executable, "-c", code], {"PYTHONPATH": str(source), "PYTHONSAFEPATH": "1"}
    done = subprocess.run(command, env=os.environ | path | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def copied(to: Path) -> Path:
    """A copy of the package with other times, in the folder that it can be imported from."""
    shutil.copytree(PACKAGE, to / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"), copy_function=shutil.copy)
    return to


def test_a_copy_of_the_sources_flies_with_the_kernel_of_this_checkout(tmp_path: Path) -> None:
    told(FLY, PACKAGE.parent)  # compiled now, unless it was before
    assert [told(FLY, source) for source in (PACKAGE.parent, copied(tmp_path))] == ["1 0", "1 0"]


def test_sources_that_differ_have_a_kernel_of_their_own(tmp_path: Path) -> None:
    other = copied(tmp_path)
    assert told(FOLDER, other) == str(kernel_folder(TRACKER))
    with (other / PACKAGE.name / "flight" / "kernel" / "walls.py").open("a", encoding="utf-8") as file:
        file.write("# another version\n")
    assert told(FOLDER, other) != str(kernel_folder(TRACKER))


@pytest.mark.slow
def test_of_two_copies_the_second_loads_what_the_first_compiled_until_it_changes(tmp_path: Path) -> None:
    one, two, kernels = copied(tmp_path / "one"), copied(tmp_path / "two"), str(tmp_path / "kernels")
    assert [told(FLY, source, WAKEFLOW_KERNELS=kernels) for source in (one, two)] == ["0 1", "1 0"]
    assert len(list(Path(kernels).iterdir())) == 1
    with (two / PACKAGE.name / "flight" / "kernel" / "walls.py").open("a", encoding="utf-8") as file:
        file.write("# another version\n")
    assert [told(FLY, source, WAKEFLOW_KERNELS=kernels) for source in (one, two)] == ["1 0", "0 1"]


def _twice(x: float) -> float:
    return 2.0 * x


def compiled_anew() -> bool:
    """Whether a kernel was compiled, not read, for a call; its answer is right either way."""
    kernel: Any = jit.entry(_twice)
    assert kernel(1.5) == 3.0
    return not kernel.stats.cache_hits


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def flip(path: Path) -> None:
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    path.write_bytes(whole)


@pytest.mark.parametrize("damage", [cut, flip, Path.unlink, lambda path: path.write_bytes(b"")])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_file_is_compiled_anew_and_heals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, damage: Callable[[Path], None]
) -> None:
    monkeypatch.setattr(jit, "kernel_folder", lambda module: tmp_path)
    assert [compiled_anew(), compiled_anew()] == [True, False]
    (file,) = tmp_path.glob(f"*.{kind}")
    damage(file)
    assert [compiled_anew(), compiled_anew()] == [True, False]


def test_a_folder_that_cannot_be_made_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(jit, "kernel_folder", lambda module: tmp_path / "file" / "kernels")
    assert [compiled_anew(), compiled_anew()] == [True, True]
