"""A force on the air in OpenFOAM 1912: whole on the cells, felt by the air as momentum says, the same when resumed."""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import kept_airflow, rhombus_spec
from wakeflow.air.foam import airflow
from wakeflow.air.foam.airflow import solve_airflow
from wakeflow.air.foam.airflow_result import AirflowResult
from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.foam.momentum_source import SOURCE, cell_forces, write_source
from wakeflow.air.foam.polymesh import read_polymesh
from wakeflow.air.foam.programs import AirflowFailure, Cause
from wakeflow.air.foam.read import time_folders
from wakeflow.air.foam.sanity import Check, check_airflow
from wakeflow.air.foam.watch import Progress
from wakeflow.core.geometry import Boxes, ForceDensity

pytestmark = pytest.mark.openfoam

BOXES = Boxes.across(0.3, 0.06, 0.16, 0.05)  # over the whole channel, 0.1 m high, above the body
PUSH = 40.0  # N/m3


@dataclass(frozen=True)
class Bare:
    spec: FlowSpec
    folder: Path
    result: AirflowResult

    @property
    def msh(self) -> Path:
        return self.folder / "mesh.msh"

    @property
    def case(self) -> Path:
        return self.folder / "case"


@pytest.fixture(scope="module")
def bare() -> Bare:
    """Half of a channel with a rhombus in a thousand cells, without a force."""
    spec = rhombus_spec(rung="draft", half=True, scale=3.0)
    return Bare(spec, *kept_airflow(spec))


def uniform(force: float) -> ForceDensity:
    return ForceDensity(BOXES, np.broadcast_to((0.0, force), (BOXES.rows, BOXES.columns, 2)))


def rough() -> ForceDensity:
    """A force in boxes smaller and larger than the cells beside them, its own mirror image."""
    boxes = Boxes.across(0.3, -0.1, 0.16, 0.004)
    density = np.random.default_rng(3).normal(size=(boxes.rows, boxes.columns, 2)) * (5.0, 30.0)
    return ForceDensity(boxes, density).mirrored()


def members(cell_set: Path) -> set[int]:
    return {int(number) for number in cell_set.read_text().split("(")[1].split(")")[0].split()}


def test_cells_and_levels_keep_the_whole_force(bare: Bare, tmp_path: Path) -> None:
    plane = read_polymesh(bare.case).plane
    shutil.copytree(bare.case / "constant", tmp_path / "constant")
    force = rough()
    laid = write_source(tmp_path, force, bare.spec.density)
    right = force.density[:, force.boxes.columns // 2 :].sum(axis=(0, 1)) * force.boxes.pitch**2
    assert laid.force == pytest.approx(tuple(right), rel=1e-12)
    assert laid.force[1] == pytest.approx(force.total[1] / 2, rel=1e-12)
    cells = cell_forces(force, plane)
    options = (tmp_path / "constant" / "fvOptions").read_text()
    assert options.count("vectorSemiImplicitSource") == laid.sources
    named = {path.name for path in (tmp_path / "constant" / "polyMesh" / "sets").iterdir()}
    assert len(named) == laid.sources
    for axis, letter in enumerate("XY"):  # every cell in one level of each component, within one level's width
        values = np.full(len(cells), np.nan)
        for name in (name for name in named if name.startswith(f"force{letter}")):
            members = (tmp_path / "constant" / "polyMesh" / "sets" / name).read_text().split("(")[1].split(")")[0]
            numbers = options.split(f"\n{name}\n")[1].split("((")[1].split(")")[0].split()
            values[np.array(members.split(), dtype=int)] = float(numbers[axis]) * bare.spec.density
        felt = ~np.isnan(values)
        assert felt.sum() == np.count_nonzero(cells[:, axis])
        assert np.abs(values - cells[:, axis])[felt].max() <= np.ptp(cells[felt, axis]) / 32 * (1 + 1e-9)


def test_each_layer_of_an_extruded_case_feels_the_force_of_the_plane(bare: Bare, tmp_path: Path) -> None:
    plane, deep = tmp_path / "plane", tmp_path / "plane" / "span"
    shutil.copytree(bare.case / "constant", plane / "constant")
    shutil.copytree(bare.case / "constant", deep / "constant")
    cells = cell_forces(rough(), read_polymesh(plane).plane)
    over = np.random.default_rng(5).permutation(np.tile(np.arange(len(cells)), 3))
    np.savez(plane / "layers.npz", at=over)
    flat, laid = (write_source(plane, rough(), bare.spec.density, where) for where in (None, deep))
    assert laid == flat
    for file in (plane / "constant" / "polyMesh" / "sets").iterdir():
        one, three = members(file), members(deep / file.relative_to(plane))
        assert {int(over[cell]) for cell in three} == one
        assert len(three) == 3 * len(one)
    assert (deep / "constant" / "fvOptions").read_text() == (plane / "constant" / "fvOptions").read_text()


def test_nothing_is_written_for_no_force(bare: Bare, tmp_path: Path) -> None:
    shutil.copytree(bare.case / "constant", tmp_path / "constant")
    write_source(tmp_path, rough(), bare.spec.density)
    laid = write_source(tmp_path, uniform(0.0), bare.spec.density)
    assert (laid.force, laid.cells, laid.sources) == ((0.0, 0.0), 0, 0)
    assert not list((tmp_path / "constant" / "polyMesh" / "sets").iterdir())


def test_a_force_across_the_whole_channel_is_all_pressure(bare: Bare, tmp_path: Path) -> None:
    """Momentum: a uniform force s over the length L holds the pressure s L, and changes no velocity."""
    result = solve_airflow(bare.spec, bare.msh, tmp_path / "case", force=uniform(PUSH), start=bare.case)
    rise = PUSH * BOXES.rows * BOXES.pitch  # against the air, which flows down: the pressure before it grows
    assert result.pressure_drop - bare.result.pressure_drop == pytest.approx(rise, rel=0.01)
    assert result.cd.value == pytest.approx(bare.result.cd.value, rel=2e-3)
    laid = json.loads((tmp_path / "case" / SOURCE).read_text())
    assert laid["force"] == pytest.approx([0.0, rise * 0.15], rel=1e-12)  # N/m on half of the channel's width


def test_a_force_on_part_of_the_channel_turns_the_air_aside(bare: Bare, tmp_path: Path) -> None:
    """A curtain of 0.1 m in 0.3 m: the air behind it is slower, and the drag of the body below it less."""
    density = np.zeros((BOXES.rows, BOXES.columns, 2))
    density[:, 2:4, 1] = PUSH
    force = ForceDensity(BOXES, density)
    result = solve_airflow(bare.spec, bare.msh, tmp_path / "case", force=force, start=bare.case)
    assert 0.7 < result.cd.value / bare.result.cd.value < 0.95
    rise = PUSH * BOXES.rows * BOXES.pitch
    assert 0.2 * rise < result.pressure_drop - bare.result.pressure_drop < 0.9 * rise
    assert result.verdict == "steady"


def test_air_that_a_curtain_drives_meets_the_body_with_more_pressure_than_it_came_with(
    bare: Bare, tmp_path: Path
) -> None:
    """As a dense feed does; a solution with so much pressure is refused where no force is known of."""
    density = np.zeros((BOXES.rows, BOXES.columns, 2))
    density[:, 2:4, 1] = -15 * PUSH
    force = ForceDensity(BOXES, density)
    assert force.pressure == pytest.approx(15 * PUSH * BOXES.rows * BOXES.pitch)
    result = solve_airflow(bare.spec, bare.msh, tmp_path / "case", force=force, start=bare.case)
    assert result.attempts == ()
    added = force.pressure / (0.5 * 1.2 * 5.0**2)  # all of it; the curtain also draws faster air in at the inlet
    assert result.cp_front - bare.result.cp_front == pytest.approx(added, rel=0.1)
    (tmp_path / "case" / SOURCE).unlink()
    with pytest.raises(AirflowFailure, match="largest Cp"):
        check_airflow(bare.spec, tmp_path / "case", result)


def test_settings_that_serve_at_the_second_try_keep_the_force(
    bare: Bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first attempt is refused as if its numbers were impossible: what is solved again feels the same force."""
    refused: list[str] = []

    def once(*args: Any) -> list[Check]:
        if not refused:
            refused.append("now")
            raise AirflowFailure(Cause.NONSENSE, "the airflow is not possible: a test says so")
        return check_airflow(*args)

    monkeypatch.setattr(airflow, "check_airflow", once)
    result = solve_airflow(bare.spec, bare.msh, tmp_path / "case", force=uniform(PUSH), start=bare.case)
    assert (result.settings, len(result.attempts)) == ("careful", 1)
    spec = replace(bare.spec, settings="careful")
    without = solve_airflow(spec, bare.msh, tmp_path / "without", start=tmp_path / "case")
    assert (without.settings, without.attempts) == ("careful", ())
    rise = PUSH * BOXES.rows * BOXES.pitch
    assert result.pressure_drop - without.pressure_drop == pytest.approx(rise, rel=0.01)
    laid = json.loads((tmp_path / "case" / SOURCE).read_text())
    assert laid["force"] == pytest.approx([0.0, rise * 0.15], rel=1e-12)


class Stop(Exception):
    pass


def test_an_interrupted_one_goes_on_to_the_same_air(bare: Bare, tmp_path: Path) -> None:
    force = uniform(PUSH)
    solve_airflow(bare.spec, bare.msh, tmp_path / "whole", force=force, start=bare.case)

    def stop(now: Progress) -> None:
        if now.time > 0:  # in the first segment, which is then repeated
            raise Stop

    with pytest.raises(Stop):
        solve_airflow(bare.spec, bare.msh, tmp_path / "cut", force=force, start=bare.case, listener=stop)
    solve_airflow(bare.spec, bare.msh, tmp_path / "cut", force=force, start=bare.case)
    whole, cut = (time_folders(tmp_path / name)[-1] for name in ("whole", "cut"))
    assert whole.name == cut.name
    for name in ("U", "p", "k", "omega"):
        assert (whole / name).read_bytes() == (cut / name).read_bytes()
