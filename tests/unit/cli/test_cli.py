"""The command line: exit codes, one-line errors, options."""

import json
from importlib.metadata import version
from pathlib import Path

import pytest

import wakeflow as wf
from wakeflow.cli import app, main
from wakeflow.core.errors import SceneError
from wakeflow.core.files import scene_templates
from wakeflow.scene import Scene
from wakeflow.show.terminal import show_result


def test_plan_names_what_is_used_and_left_out(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(cases / "rhombus.toml"), "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["airflow"]["rung"] == "standard"
    assert plan["fractions"]["wheat"]["mode"] == "resolved"  # the air before the body moves it by more than 1 % allows
    met = {name: row["impaction"]["efficiency"] for name, row in plan["fractions"].items()}
    assert met["wheat"] > 0.9 > met["chaff"] > 0.8 > met["dust"]
    names = {row["name"] for row in plan["left_out"]}
    assert {"buoyancy", "basset-history", "brownian", "vibration-of-the-air"} <= names
    assert all(row["why"] for row in plan["left_out"])


def test_a_materials_density_changes_its_fall_not_its_shape(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = {}
    for density in (650, 1300, 2600):
        arguments = ["plan", str(cases / "rhombus.toml"), "--json", "--set", f"fraction.wheat.density={density}"]
        assert main(arguments) == 0
        found[density] = json.loads(capsys.readouterr().out)["fractions"]["wheat"]
    assert len({row["drag_scale"] for row in found.values()}) == 1
    assert found[1300]["terminal_velocity"] == pytest.approx(7.8)
    assert found[2600]["terminal_velocity"] / found[1300]["terminal_velocity"] == pytest.approx(2**0.5, rel=0.1)


def test_per_cent_on_the_command_line(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plans = []
    for arguments in (["--target-error", "5%"], ["--target-error", "0.05"], ["--set", "numerics.target_error=5 %"]):
        assert main(["plan", str(cases / "rhombus.toml"), "--json", *arguments]) == 0
        plans.append(json.loads(capsys.readouterr().out))
    assert plans[0] == plans[1] == plans[2]


def test_plan_prints_for_people(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["plan", str(cases / "vacuum.toml"), "--set", "feed.count=32"]) == 0
    assert "none: granules fly in a vacuum" in capsys.readouterr().out
    assert main(["plan", str(cases / "vacuum.toml"), "--all"]) == 0
    assert "no [air] table" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "nowhere.toml"], "no scene file 'nowhere.toml'"),
        (["run", "{cases}/vacuum.toml", "--rung", "draft"], "needs an [air] table"),
        (["run", "{cases}/aspirator.toml", "--rung", "none"], "without a body nothing is left"),
        (["run", "{cases}/rhombus.toml", "--rung", "best"], "Choose from"),
        (["run", "{cases}/rhombus.toml", "--set", "air.speed"], "KEY=VALUE"),
        (["run", "{cases}/rhombus.toml", "--set", ".=3"], "'.=3': write it as KEY=VALUE"),
        (["run", "{cases}/rhombus.toml", "--set", "air.speed = -3"], "air.speed = -3: too small"),
        (["run", "{cases}/rhombus.toml", "--force", "lift"], "write it as TERM=on or TERM=off"),
        (["run", "{cases}/rhombus.toml", "--set", "air.speed=7", "m/s"], "with blanks: --set 'air.speed=7 m/s'"),
        (["run", "--set", "air.speed=7", "m/s", "{cases}/rhombus.toml", "--json"], "--set 'air.speed=7 m/s'"),
        (["run", "{cases}/rhombus.toml", "--set", "air.speed", "=", "7"], "--set 'air.speed = 7'"),
        (["run", "{cases}/rhombus.toml", "elsewhere"], "Unused Tokens: ['elsewhere']"),
        (["run", "{cases}/rhombus.toml", "--set", "air.speed=1,5 m/s"], "a decimal point is written"),
        (["run", "{cases}/rhombus.toml", "--set", "fraction.wheet.density=1300"], "did you mean 'wheat'?"),
        (["run", "{cases}/rhombus.toml", "--target-error", "five"], "'five': needs a share such as 0.05 or 5%"),
        (["run", "{cases}/rhombus.toml", "--target-error", "0,5 %"], "thousands without a mark: '0.5 %'"),
        (["run", "{cases}/rhombus.toml", "--force", "gravitation=off"], "unknown term"),
        (["run", "{cases}/rhombus.toml", "--force", "chaf.lift=on"], "no fraction 'chaf'"),
        (["run", "{cases}/rhombus.toml", "--force", "drag=off"], "always acts"),
        (["run", "{cases}/vacuum.toml", "--force", "lift=on"], "add an [air] table"),
        (["run", "{cases}/rhombus.toml", "--force", "buoyancy=maybe"], "write on or off"),
        (["run", "{cases}/vacuum.toml", "--out", "{cases}/vacuum.toml"], "is a file"),
        (["plan", "{cases}/rhombus.toml", "--set", "fraction.wheat.terminal_velocity=100"], "times a sphere's drag"),
        (["plan", "{cases}/rhombus.toml", "--set", "fraction.chaff.density=1",
          "--set", "fraction.chaff.terminal_velocity=1"], "lighter than air"),
        (["run", "{cases}/vacuum.toml", "--out", "/proc/x"], "choose another --out"),
        (["run", "{cases}/vacuum.toml", "--workers", "0"], "at least 1"),
        (["plan", "{cases}/vacuum.toml", "--workers", "-3"], "at least 1"),
        (["run"], "scene"),
        (["fly"], 'Unknown command "fly"'),
        (["new", "rombus"], "did you mean 'rhombus'?"),
        (["report", "nowhere"], "holds no finished run"),
    ],
)  # fmt: skip
def test_wrong_input_is_one_line_and_code_2(
    arguments: list[str], message: str, cases: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([a.replace("{cases}", str(cases)) for a in arguments]) == 2
    error = capsys.readouterr().err
    assert message.lower() in error.lower()
    assert len(error.strip().splitlines()) == 1


@pytest.mark.parametrize("kind", scene_templates())
def test_a_new_scene_names_itself_and_replaces_no_file(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind, "my machine.toml"]) == 0
    text, shipped = Path("my machine.toml").read_text(), scene_templates()[kind].read_text()
    assert capsys.readouterr().out.endswith("run it with: wakeflow run 'my machine.toml'\n")
    assert "wakeflow run cases/" not in text
    assert text.count("wakeflow run 'my machine.toml'") == 1 + shipped.count(f"wakeflow run cases/{kind}.toml")
    assert text.startswith("# Look at it:  wakeflow plan 'my machine.toml'")
    assert Scene.load("my machine.toml") == Scene.load(scene_templates()[kind])
    assert main(["new", kind, "my machine.toml"]) == 2
    assert "exists" in capsys.readouterr().err


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed(shell: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["--install-completion", "--shell", shell, "--output", str(tmp_path / "script")]) == 0
    script = (tmp_path / "script").read_text()
    assert all(word in script for word in ("wakeflow", "doctor", "target-error"))


def test_new_lists_every_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "--help"]) == 0
    shown = capsys.readouterr().out
    assert all(kind in shown for kind in scene_templates())


def test_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Scene"


def test_a_new_command_is_one_function(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def count(scene: Path, *, body: str | None = None) -> int:
        """Print how many fractions a scene has.

        Parameters
        ----------
        scene
            A scene file (TOML).
        body
            A body that the scene must have.
        """
        asked = Scene.load(scene)
        if body is not None and body not in asked.body:
            raise SceneError(f"no body {body!r} (known: {', '.join(asked.body)})")
        print(len(asked.fraction))
        return 0

    app.command(count)
    try:
        assert main(["count", str(cases / "rhombus.toml")]) == 0
        assert capsys.readouterr().out == "3\n"
        assert main(["count", str(cases / "rhombus.toml"), "--body", "cone"]) == 2
        assert capsys.readouterr().err == "wakeflow: no body 'cone' (known: rhombus)\n"
        assert main(["--help"]) == 0
        assert "Print how many fractions a scene has." in capsys.readouterr().out
    finally:
        del app["count"]


@pytest.mark.parametrize("lacking", [0, 1])
def test_no_interval_of_a_share_is_broken(
    small_run: wf.Result, lacking: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the screen is too narrow for them side by side, by one letter too, intervals are below their numbers."""
    wide = 200
    monkeypatch.setenv("COLUMNS", str(wide))
    show_result(small_run)
    table = capsys.readouterr().out.split("share of each")[1].split("recovery")[0].splitlines()[2:]
    monkeypatch.setenv("COLUMNS", str(max(len(line.rstrip()) for line in table) + 1 - lacking))
    show_result(small_run)
    found = capsys.readouterr().out.split("share of each")[1].split("recovery")[0].splitlines()[2:]
    assert all(line.count("(") == line.count(")") for line in found)
    assert len(found) == len(table) if lacking == 0 else len(found) > len(table)


def test_a_vacuum_is_not_told_to_resolve_a_wake(small_run: wf.Result, capsys: pytest.CaptureFixture[str]) -> None:
    show_result(small_run)
    told = " ".join(capsys.readouterr().out.split())
    assert "and it becomes" in told
    assert "How to measure: docs/uncertainty.md" in told
    assert "3d" not in told


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == wf.__version__ == version("wakeflow-separation")
