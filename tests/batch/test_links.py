"""Fields stand once on the disk, however many runs show them."""

from pathlib import Path

import wakeflow as wf
from support import ALONE, shipped


def test_runs_in_one_airflow_share_the_fields_files(tmp_path: Path) -> None:
    scene = shipped("aspirator", {"feed.count": 16, "numerics.mesh_scale": 2.0})
    first, second = (
        wf.run(scene.replace({"fraction.straw.target": target}), tmp_path / target, force=ALONE).folder / "field.vtu"
        for target in ("light", "heavy")
    )
    assert first.samefile(second)
    before = first.read_bytes()
    wf.run(scene.replace({"air.speed": 5.0}), tmp_path / "heavy", force=ALONE)  # another airflow in the second folder
    assert not first.samefile(second)
    assert first.read_bytes() == before
