"""Another processor rounds sums otherwise: shares stay within what computing may add, and no stage costs more."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import wakeflow as wf

OTHER = {"NUMBA_CPU_NAME": "generic", "OPENBLAS_CORETYPE": "Prescott"}  # of 2004
STARTS = 0.5  # s of a stage that are no computing: files, and threads that start


def computed(folder: Path, cases: Path, environment: dict[str, str]) -> wf.Result:
    """A run with its kernels compiled before, everything else computed now."""
    words = ["run", str(cases / "vacuum.toml"), "--set", "feed.count=256", "--quiet", "--out"]
    for time in ("compiled", "computed"):
        env = os.environ | environment | {"WAKEFLOW_CACHE": str(folder / time / "cache")}
        command = [sys.executable, "-m", "wakeflow.cli", *words, str(folder / time / "run")]
        subprocess.run(command, env=env, check=True, timeout=900)
    return wf.Result.load(folder / "computed" / "run")


@pytest.mark.slow
@pytest.mark.timeout(2000)
def test_another_set_of_instructions_moves_no_share_beyond_its_numerical_part(cases: Path, tmp_path: Path) -> None:
    here, there = (computed(tmp_path / name, cases, env) for name, env in (("here", {}), ("there", OTHER)))
    for fraction in here.scene["fraction"]:
        for place in [*here.scene["bin"], "elsewhere"]:
            own, other = (result.share(fraction, place) for result in (here, there))
            assert own.numerical is not None
            assert abs(own.value - other.value) <= own.numerical, (fraction, place)
    for stage, spent in here.seconds.items():
        assert there.seconds[stage].seconds < 1.5 * spent.seconds + STARTS, stage
