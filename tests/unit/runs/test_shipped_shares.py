"""Where the granules of every shipped scene land, on a coarse mesh: the shares of shipped_shares.toml, one table.

``python tests/unit/runs/test_shipped_shares.py`` writes the table anew. A commit that changes it says why.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

from support import ALONE, CASES, shipped
from wakeflow.answer.separation import separate
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan

TABLE = Path(__file__).with_name("shipped_shares.toml")
SCENES = [path.stem for path in sorted(CASES.glob("*.toml")) if "fraction" in tomllib.loads(path.read_text())]
COARSE = {"feed.count": 256, "numerics.mesh_scale": 4.0}
CHANCE = 6.0  # granules of 256 that the rounding of another processor may send elsewhere


def shares(name: str) -> dict[str, dict[str, float]]:
    """Share of each fraction in each bin that it reaches."""
    scene = shipped(name, COARSE)
    rung = "draft" if scene.body and scene.air else None
    pipeline = Pipeline(scene, make_plan(scene, rung=rung, force=ALONE))
    landed = separate(scene, pipeline.tracks().landings).fractions
    return {fraction: {place: round(float(share.value), 3) for place, share in places.items() if share.value > 0.0}
            for fraction, places in landed.items()}  # fmt: skip


@pytest.mark.openfoam
@pytest.mark.parametrize("name", SCENES)
def test_granules_of_a_shipped_scene_land_where_they_did(name: str) -> None:
    before = tomllib.loads(TABLE.read_text(encoding="utf-8"))[name]
    now = shares(name)
    assert list(now) == list(before)
    for fraction, places in before.items():
        assert sum(now[fraction].values()) == pytest.approx(1.0, abs=0.01)
        for place in {*places, *now[fraction]}:
            off = abs(now[fraction].get(place, 0.0) - places.get(place, 0.0))
            assert off <= CHANCE / COARSE["feed.count"], (fraction, place, now[fraction])


def main() -> None:
    """Write the table."""
    lines = ["# Written by tests/unit/runs/test_shipped_shares.py: share of each fraction in each bin that it reaches"]
    for name in SCENES:
        for fraction, places in shares(name).items():
            row = ", ".join(f"{place} = {share}" for place, share in places.items())
            lines.append(f"{name}.{fraction} = {{ {row} }}")
        print(lines[-1], flush=True)
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
