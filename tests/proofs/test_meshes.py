"""The study of the ways to mesh: its judgement on rows made up, and the study itself on coarse meshes."""

from __future__ import annotations

import pytest

from proofs.airflow.meshes import FLOWS, NUMBERS, errors, flow_of, run_meshes


def row(cells: int, order: float = 2.0) -> dict[str, float]:
    size = cells**-0.5
    return {
        "cells": cells,
        "cd": 1.5 + 9 * size**order,
        "cp_base": -1 - 5 * size**order,
        "reversal": 3 + 7 * size**order,
    }


def test_the_truth_is_extrapolated_from_the_finest_rows() -> None:
    rows = [row(cells) for cells in (500, 1000, 2000, 4000, 8000)]
    truth, judged = errors(rows, rows[:1:-1])
    assert truth == pytest.approx({"cd": 1.5, "cp_base": -1.0, "reversal": 3.0})
    assert [each["cd_error"] for each in judged] == pytest.approx(
        [6 / cells for cells in (500, 1000, 2000, 4000, 8000)]
    )


def test_rows_that_do_not_converge_are_held_against_the_finest() -> None:
    rows = [row(1000) | {"cd": 1.5}, row(2000) | {"cd": 1.6}, row(4000) | {"cd": 1.52}]
    truth, judged = errors(rows, rows[::-1])
    assert truth["cd"] == 1.52
    assert judged[-1]["cd_error"] == 0
    assert judged[-1]["reversal_error"] > 0


@pytest.mark.parametrize("flow", FLOWS)
def test_flows_differ_in_the_mesh_only(flow: str) -> None:
    one, other = flow_of(flow, "quads", 1.0), flow_of(flow, "triangles", 2.0)
    assert one.mesh.half
    assert other.mesh.strategy == "triangles"
    assert other.mesh.h_body == pytest.approx(2 * one.mesh.h_body)
    assert (one.reynolds, one.turbulence, one.mesh.top) == (other.reynolds, other.turbulence, other.mesh.top)


@pytest.mark.slow
@pytest.mark.openfoam
def test_every_strategy_comes_near_to_the_laminar_truth() -> None:
    told: list[str] = []
    report = run_meshes(tell=told.append, scales=(2.0,), finest=(2**0.5, 1.0), flows=FLOWS[:1])
    table = report.data()["flows"][FLOWS[0]]
    assert table["truth"]["cd"] == pytest.approx(1.753, rel=0.005)
    assert {each["strategy"] for each in table["rows"]} == {"quads", "triangles"}
    assert len(told) == len(table["rows"]) == 4
    for each in table["rows"]:
        assert each["seconds"] > 0
        assert all(each[f"{name}_error"] < 0.03 for name in NUMBERS)
