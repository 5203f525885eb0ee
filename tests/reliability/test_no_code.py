"""Nothing that is read is run: no pickle of a folder that may come from others, no code in an OpenFOAM case."""

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from wakeflow.core.errors import SceneError
from wakeflow.core.sources import kernel_root
from wakeflow.scene.case_code import refuse_code
from wakeflow.scene.own_files import find_case

HEADER = "FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"


@pytest.fixture
def case(cases: Path, tmp_path: Path) -> Path:
    """The program's own template as a case that somebody has solved."""
    case = tmp_path / "case"
    for part in ("system", "constant", "0"):
        shutil.copytree(cases / "template" / part, case / part)
    shutil.copytree(case / "0", case / "500")
    (case / "constant" / "polyMesh").mkdir()
    (case / "constant" / "polyMesh" / "boundary").write_text("1(inlet { type patch; nFaces 1; startFace 1; })")
    (case / "system" / "parameters").write_text("stepping steady;\nsettings safer;\nnu 1.5e-5;\n")
    return case


def test_a_case_without_code_passes(case: Path) -> None:
    assert find_case(str(case), case) == case
    (case / "system" / "controlDict").write_text('functions { forces { type forces; libs ("libforces.so"); } }')
    refuse_code(case, case / "500")


CODE = {
    "#codeStream": "value #codeStream { code #{ os << 1; #}; };",
    "#calc": 'speed #calc "1 + system(\\"id\\")";',
    "#eval": "speed #eval{ 1 + 1 };",
    "coded condition": "inlet { type codedFixedValue; name x; }",
    "coded function": "functions { f { type coded; } }",
    "code": "codeWrite #{ system(1); #};",
    "systemCall": 'functions { f { type systemCall; executeCalls ("id"); } }',
    "libs": 'libs ("../evil.so");',
    "absolute libs": 'libs\n(\n    "/anywhere/evil.so"\n);',
    "include of a file": '#include "/etc/passwd"',
    "include above": '#includeIfPresent "../../outside"',
    "include of a home": '#include "~/.ssh/id_rsa"',
    "include of a variable": '#include "$HOME/x"',
    "include of the installation": '#includeEtc "caseDicts/setConstraintTypes"',
}


@pytest.mark.parametrize("place", ["system/controlDict", "constant/transportProperties", "500/U"])
@pytest.mark.parametrize("name", CODE)
def test_code_in_a_case_is_refused(name: str, place: str, case: Path) -> None:
    path = case / place
    path.write_text(f"{path.read_text()}\n{CODE[name]}\n")
    with pytest.raises(SceneError, match=rf"air.case: {place} has .*; a case is read and never run"):
        find_case(str(case), case)


@pytest.mark.parametrize("comment", ["// {code}", "/* {code} */"])
def test_code_in_a_comment_is_none(comment: str, case: Path) -> None:
    path = case / "system" / "controlDict"
    path.write_text(f"{path.read_text()}\n{comment.format(code=CODE['systemCall'])}\n")
    refuse_code(case, case / "500")


class Bomb:
    """Makes a folder where it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.folder),)


def test_the_index_of_kernels_in_a_cache_is_not_read(tmp_path: Path) -> None:
    """A folder of results that comes with a cache, runs/.cache, as it was before: with kernels that are pickles."""
    from wakeflow.core.sources import code_key

    for module, kernel in (("wakeflow.tracking.kernel.loop", "loop.fly_block"), ("wakeflow.tracking", "x")):
        folder = tmp_path / "runs" / ".cache" / "numba" / code_key(module)[:20]
        for place in (folder, folder / "kernel_0"):
            place.mkdir(parents=True)
            (place / f"{kernel}-268.py311.nbi").write_bytes(
                pickle.dumps("0.68.1") + pickle.dumps(Bomb(tmp_path / "ran"))
            )
    code = (
        "import numpy as np; from wakeflow.tracking import Granules, track\n"
        "track(None, Granules(np.zeros((1, 2)), np.ones((1, 2)), diameter=1e-3, density=1.0), until=1.0)"
    )
    environment = {key: value for key, value in os.environ.items() if key != "WAKEFLOW_CACHE"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    assert not (tmp_path / "ran").exists()
    assert not kernel_root().is_relative_to(tmp_path)


ROOT_OF_KERNELS = "from wakeflow.core.sources import kernel_root; print(kernel_root())"


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
