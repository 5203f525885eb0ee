"""Nothing that is read is run: no pickle of a folder that may come from others, no stage that others began."""

import os
import pickle
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from support import begun_part
from wakeflow.core.files import _user_folder, kernel_root, user_secret
from wakeflow.core.store import BEGUN, Store

KEY, OTHER = "a" * 64, "b" * 64


# -- An unfinished stage in a cache that may come from others ----------------------------------------------------------
def begun(root: Path, key: str = KEY) -> Path:
    part = begun_part(root, "airflow", key)
    (part / "case" / "system").mkdir(parents=True)
    (part / "case" / "system" / "controlDict").write_text("functions { f { type coded; } }")
    return part


def _copied(part: Path) -> None:
    """As an archive of a cache is unpacked: with a seal, which was of another folder."""
    part.rename(part.with_suffix(".old"))
    shutil.copytree(part.with_suffix(".old"), part)


def _sealed_elsewhere(part: Path) -> None:
    shutil.copy(begun(part.parents[1], OTHER) / BEGUN, part / BEGUN)


def _linked(part: Path) -> None:
    part.rename(part.with_suffix(".old"))
    part.symlink_to(part.with_suffix(".old"))


FOREIGN: dict[str, Callable[[Path], object]] = {
    "no seal": lambda part: (part / BEGUN).unlink(),
    "an empty seal": lambda part: (part / BEGUN).write_bytes(b""),
    "a seal of another stage": _sealed_elsewhere,
    "a seal that is a folder": lambda part: ((part / BEGUN).unlink(), (part / BEGUN).mkdir()),
    "a seal that is a pipe": lambda part: ((part / BEGUN).unlink(), os.mkfifo(part / BEGUN)),
    "a copy": _copied,
    "a link": _linked,
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_stage_that_others_began_is_begun_anew(name: str, tmp_path: Path) -> None:
    part = begun(tmp_path)
    FOREIGN[name](part)
    seen: list[str] = []
    folder, _ = Store(tmp_path).make("airflow", KEY, lambda part: seen.extend(path.name for path in part.iterdir()))
    assert seen == [BEGUN]
    assert [path.name for path in folder.iterdir()] == ["manifest.json"]


def test_a_stage_of_ones_own_goes_on(tmp_path: Path) -> None:
    part, seen = begun(tmp_path), []
    Store(tmp_path).make("airflow", KEY, lambda part: seen.extend(path.name for path in part.iterdir()))
    assert sorted(seen) == [BEGUN, "case"]
    assert not part.exists()


def test_nobody_else_reads_what_seals_are_made_with() -> None:
    assert len(user_secret()) == 32
    assert user_secret() == user_secret()
    (secret,) = _user_folder("seals").iterdir()
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600


class Bomb:
    """Makes a folder where it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.folder),)


def test_the_index_of_kernels_in_a_cache_is_not_read(tmp_path: Path) -> None:
    """A folder of results that comes with a cache, runs/.cache, as it was before: with kernels that are pickles."""
    from wakeflow.core.code_key import code_key

    for module, kernel in (("wakeflow.flight.kernel.loop", "loop.fly_block"), ("wakeflow.flight", "x")):
        folder = tmp_path / "runs" / ".cache" / "numba" / code_key(module)[:20]
        for place in (folder, folder / "kernel_0"):
            place.mkdir(parents=True)
            (place / f"{kernel}-268.py311.nbi").write_bytes(
                pickle.dumps("0.68.1") + pickle.dumps(Bomb(tmp_path / "ran"))
            )
    code = (
        "import numpy as np; from wakeflow.flight import Granules, track\n"
        "track(None, Granules(np.zeros((1, 2)), np.ones((1, 2)), diameter=1e-3, density=1.0), until=1.0)"
    )
    environment = {key: value for key, value in os.environ.items() if key != "WAKEFLOW_CACHE"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    assert not (tmp_path / "ran").exists()
    assert not kernel_root().is_relative_to(tmp_path)


ROOT_OF_KERNELS = "from wakeflow.core.files import kernel_root; print(kernel_root())"


def where(**environment: str) -> Path:
    base = {
        key: value for key, value in os.environ.items() if key not in ("WAKEFLOW_KERNELS", "XDG_CACHE_HOME", "HOME")
    }
    done = subprocess.run(
        [sys.executable, "-c", ROOT_OF_KERNELS], env=base | environment, capture_output=True, text=True, check=True
    )
    return Path(done.stdout.strip())


def test_kernels_live_in_the_users_own_cache_and_where_others_may_write_none_is_believed(tmp_path: Path) -> None:
    assert where(HOME=str(tmp_path)) == tmp_path / ".cache" / "wakeflow" / "kernels"
    assert where(XDG_CACHE_HOME=str(tmp_path / "x")) == tmp_path / "x" / "wakeflow" / "kernels"
    assert where(HOME=str(tmp_path), WAKEFLOW_KERNELS=str(tmp_path / "asked")) == tmp_path / "asked"
    (tmp_path / ".cache" / "wakeflow" / "kernels").chmod(0o777)
    found = where(HOME=str(tmp_path))
    assert found.name.startswith("wakeflow-kernels-")
    assert not found.exists()  # it ended with its process
