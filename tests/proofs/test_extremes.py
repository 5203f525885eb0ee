"""The stability matrix: every row that is registered holds, and how a row is judged."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import proofs.extremes.plain_scenes  # noqa: F401 - both register rows
from proofs.extremes import matrix
from proofs.extremes.flying import falls_in_uniform_air
from proofs.extremes.matrix import ERROR_UNITS, Extreme, Happened, extremes, fly_extreme
from proofs.problems.exact import DENSITY, VISCOSITY, G, of_tau
from wakeflow.cli import main
from wakeflow.core.errors import SceneError

GOOD = Happened(2, {"binned": 2}, True, 0.5, 3.0, 0.1)


def marked(name: str) -> Any:
    """A row as a parameter: slow where it takes minutes, or solves an airflow."""
    row = extremes[name]
    slow = [pytest.mark.slow] if row.slow or row.openfoam else []
    return pytest.param(name, marks=[*slow, *([pytest.mark.openfoam] if row.openfoam else [])])


@pytest.mark.parametrize("name", [marked(name) for name in extremes])
def test_every_row_holds_or_is_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    row = fly_extreme(name)
    assert row["verdict"] == ("refused" if extremes[name].refused else "held"), (row["why"], row["traceback"])
    json.dumps(row)


def test_every_row_says_against_what_and_what_it_may_be() -> None:
    for name in extremes:
        row = extremes[name]
        assert row.unit in ERROR_UNITS
        assert row.refused or row.against or row.stops, name
    for asked in ("relaxation time: 1e-09 s, curved air", "granule's Reynolds number: 100000", "granules: 1e7"):
        assert asked in extremes


@pytest.fixture
def trial() -> Iterator[Any]:
    """Judge a row that is registered for it alone."""

    def judge(happens: Any, **more: Any) -> dict[str, Any]:
        extremes.add("a trial", Extreme("a", "trial", happens, **{"against": "itself", **more}))
        try:
            return fly_extreme("a trial")
        finally:
            extremes.remove("a trial")

    return judge


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({}, ""),
        ({"error": 1.5}, "error 1.5, allowed 1"),
        ({"error": np.nan}, "error nan"),
        ({"error": None}, "nothing was compared"),
        ({"finite": False}, "not finite"),
        ({"fates": {"binned": 1}}, "2 granules injected, 1 have a fate"),
        ({"fates": {"binned": 1, "stopped": 1}}, "1 of 2 granules stopped"),
    ],
)
def test_what_makes_a_row_missed(trial: Any, change: dict[str, Any], why: str) -> None:
    row = trial(lambda: Happened(**{**GOOD.__dict__, **change}))
    assert (row["verdict"] == "missed") == bool(why)
    assert why in row["why"]


def test_a_stop_that_the_row_explains_is_no_miss(trial: Any) -> None:
    stopped = Happened(1, {"stopped": 1}, True, 0.0, 1.0, 0.1)
    assert trial(lambda: stopped, stops="born inside a body")["verdict"] == "held"


@pytest.mark.parametrize(
    ("text", "refused", "verdict"),
    [
        ("size = 1: at least 2", True, "refused"),
        ("size is too small", True, "missed"),
        ("size = 1:\nat least 2", True, "refused"),  # an error escapes the line break
        ("size = 1: at least 2", False, "missed"),
    ],
)
def test_a_refusal_is_one_line_with_a_number_and_only_where_it_is_due(
    trial: Any, text: str, refused: bool, verdict: str
) -> None:
    def refuse() -> Happened:
        raise SceneError(text)

    assert trial(refuse, refused=refused)["verdict"] == verdict


def test_what_should_be_refused_and_runs_is_missed_and_so_is_a_crash(trial: Any) -> None:
    assert trial(lambda: GOOD, refused=True)["why"] == "not refused"
    row = trial(lambda: 1 / 0)
    assert row["verdict"] == "missed"
    assert "ZeroDivisionError" in row["why"]
    assert "test_extremes" in row["traceback"]


def test_the_reference_for_uniform_air_has_the_closed_form_of_linear_drag() -> None:
    for tau in (1e-3, 1.0):
        grains, until, air = of_tau(tau, [[0.1, 0.2]], [[1.0, -0.5]]), 0.4, np.array([0.3, 0.2])
        final = air + np.array([0.0, -G * tau])
        gone = tau * -np.expm1(-until / tau)
        exact = grains.position + final * until + (grains.velocity - final) * gone
        found = falls_in_uniform_air(grains, until, air, (DENSITY, VISCOSITY), "stokes", submerged=False)
        np.testing.assert_allclose(found, exact, atol=1e-10)


def test_the_command_prints_its_tables_and_fails_with_a_row(
    trial: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With two rows alone: one that is refused as it must be, one that is missed."""
    monkeypatch.chdir(tmp_path)
    refusal = "sizes: 0.5 nm"
    broken = Extreme("a", "trial", lambda: Happened(1, {"binned": 1}, True, 2.0, 1.0, 0.1), against="itself")
    few = {refusal: extremes[refusal], "a: trial": broken}
    monkeypatch.setattr(matrix, "extremes", few)
    extremes.add("a: trial", broken)
    try:
        assert main(["verify", "extremes"]) == 1
    finally:
        extremes.remove("a: trial")
    printed = capsys.readouterr().out
    assert "MISSED" in printed
    assert ">= 1 nm" in printed
    kept = json.loads(Path("runs/verify/extremes.json").read_text())
    assert kept["missed"] == ["a: trial: error 2, allowed 1"]
    assert "| a: trial | 1 binned | 2.0e+00 | 1 | tolerance | itself |" in Path("runs/verify/extremes.md").read_text()
    del few["a: trial"]
    assert main(["verify", "extremes", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["extremes"]["missed"] == []
