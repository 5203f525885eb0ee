"""Mutated scenes and command lines: an answer whose shares sum to one, or one line that says what to do."""

import io
import random
import shutil
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from hostile import as_toml, command_line, mutated

import wakeflow as wf
from support import shipped
from wakeflow.cli import main
from wakeflow.core.errors import LONGEST, WakeflowError
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

SEED = 31
HEADING = "wakeflow: "
HEAD = len(HEADING)


def is_one_line(text: str) -> bool:
    return 0 < len(text) <= LONGEST and text.isprintable()


def refused(problem: WakeflowError, number: int) -> bool:
    """That mutant ``number`` was refused as it should be: False, it was not accepted."""
    assert is_one_line(str(problem)), (number, str(problem))
    return False


def check_scene(number: int, folder: Path) -> bool:
    """Load and plan mutant ``number``; whether it was accepted."""
    tables = mutated(random.Random(f"{SEED} {number}"))
    path = folder / "mutant.toml"
    try:
        path.write_text(as_toml(tables), encoding="utf-8")
    except Exception:  # what TOML cannot say at all, of the writer: not this program's
        return False
    try:
        make_plan(Scene.load(path))
    except WakeflowError as problem:
        return refused(problem, number)
    return True


@pytest.mark.parametrize("first", [0, pytest.param(100, marks=pytest.mark.slow)])
def test_a_mutated_scene_is_planned_or_refused_in_one_line(first: int, tmp_path: Path) -> None:
    """100 in the quick suite, 10 000 with --slow; the seed of each is its number."""
    count = 100 if first == 0 else 9900
    accepted = 0
    for number in range(first, first + count):
        try:
            accepted += check_scene(number, tmp_path)
        except Exception as problem:
            raise AssertionError(
                f"mutant {number} of seed {SEED}: {type(problem).__name__}: {problem!s:.300}"
            ) from problem
    print(f"seed {SEED}: {accepted} of {count} accepted")
    assert accepted > 0.02 * count


CROSSED = [[0.0, 0.0], [0.02, 0.02], [0.02, 0.0], [0.0, 0.03]]
FLAT = [[-0.02, 0.0], [0.02, 0.0], [0.0, -0.02]]
NAMED: dict[str, tuple[str, dict[str, Any], str]] = {
    "wide": ("labyrinth", {"fraction.wheat.size": "10 mm"}, "do not pass the gap of"),
    "crossing": ("rhombus", {"body": {"one": {"shape": "polygon", "points": CROSSED}}}, "the outline crosses itself"),
    "level": (
        "rhombus",
        {"body": {"one": {"shape": "polygon", "points": FLAT, "at": [0.0, -0.1]}}},
        "body.one has a level face",
    ),
    "wall": ("rhombus", {"body.rhombus.at": ["180 mm", 0]}, "leave a gap to the wall"),
    "dots": ("rhombus", {"bin": {"a.b": {"from": 0.0, "to": 0.1}}}, "a.b"),
}


@pytest.mark.parametrize("name", NAMED)
def test_what_mutants_found_has_a_line_of_its_own(name: str) -> None:
    """Refused, or said by the plan."""
    scene, changes, words = NAMED[name]
    try:
        said = list(make_plan(shipped(scene).replace(changes), rung="none").warnings)
    except WakeflowError as problem:
        said = [str(problem)]
    assert [is_one_line(one) for one in said if words in one] == [True], said


def check_words(number: int, scene: Path, run: Path, out: Path) -> int:
    """The exit code of command line ``number``; one line of error and no traceback."""
    words = command_line(random.Random(f"{SEED} {number}"), scene, run, out)
    said, told = io.StringIO(), io.StringIO()
    with redirect_stderr(said), redirect_stdout(told):
        try:
            code = main(words)
        except SystemExit as ended:
            code = int(ended.code or 0)
    first = said.getvalue().splitlines()[:1]
    assert code in (0, 1, 2, 3), (number, words, code)
    if code in (2, 3) and first:
        assert is_one_line(first[0][HEAD:]), (number, words, first)
    assert "Traceback" not in said.getvalue()
    if code == 2:
        mistakes = said.getvalue().splitlines()
        assert all(one.startswith(HEADING) and is_one_line(one[HEAD:]) for one in mistakes), (number, words, mistakes)
    return code


@pytest.mark.parametrize("first", [0, pytest.param(60, marks=pytest.mark.slow)])
def test_a_mutated_command_line_is_obeyed_or_refused_in_one_line(
    first: int, cases: Path, small_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """60 in the quick suite, 2000 with --slow."""
    (tmp_path / "here").mkdir()
    run = shutil.copytree(small_run.folder, tmp_path / "finished")  # commands write into it
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "cache"))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    codes = []
    for number in range(first, 60 if first == 0 else 2000):
        try:
            codes.append(check_words(number, cases / "vacuum.toml", run, tmp_path))
        except Exception as problem:
            raise AssertionError(
                f"command {number} of seed {SEED}: {type(problem).__name__}: {problem!s:.500}"
            ) from problem
    print(f"seed {SEED}: exit codes {sorted((code, codes.count(code)) for code in set(codes))}")


def run_scene(number: int, folder: Path) -> str:
    """Run mutant ``number`` in a vacuum, without air or, one in ten, in the coarsest draft; its rung, "" if refused."""
    tables = mutated(random.Random(f"run {SEED} {number}"))
    small = {"feed.count": 16, "numerics.mesh_scale": 4.0, "numerics.tolerance": 1e-3}
    try:
        scene = Scene.parse(tables)
        if scene.funnel is not None:  # LIGGGHTS pours it for minutes
            return ""
        solved = scene.air is not None and scene.body and random.Random(number).random() < 0.1
        small |= {"numerics.rung": "draft" if solved else "none"} if scene.body else {}
        result = wf.run(scene.replace(small), folder, report=False, force={"collisions": False})
    except WakeflowError as problem:
        refused(problem, number)
        return ""
    for shares in result.separation["fractions"].values():
        values = [one["value"] for one in shares.values()]
        assert min(values) >= 0.0
        assert sum(values) == pytest.approx(1.0, abs=1e-9)
    return str(result.plan.rung) if scene.air is not None else "vacuum"


@pytest.mark.slow
@pytest.mark.openfoam
@pytest.mark.timeout(7200)
def test_mutated_scenes_that_run_give_shares_that_sum_to_one(tmp_path: Path) -> None:
    """Until 300 mutants have run."""
    rungs: Counter[str] = Counter()
    number = 0
    while rungs.total() - rungs[""] < 300:
        number += 1
        try:
            rungs[run_scene(number, tmp_path / f"run-{number}")] += 1
        except Exception as problem:
            raise AssertionError(
                f"run {number} of seed {SEED}: {type(problem).__name__}: {problem!s:.300}"
            ) from problem
    print(f"seed {SEED}: {number} mutants, refused {rungs.pop('')}, run {dict(rungs)}")
