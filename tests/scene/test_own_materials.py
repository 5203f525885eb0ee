"""Materials of the user's own, in a file beside the scene; and how materials are listed."""

from pathlib import Path

import numpy as np
import pytest

from support import CASES
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.laws.material import materials
from wakeflow.scene import Scene

PEAS = """
[peas]
diameter = 4.1e-3
density = 1100.0
confidence = "measured"
source = "our own lot, 2026"
[peas.terminal_velocity]
value = 6.2
std = 0.3
confidence = "measured"
source = "our own lot, 2026"
[peas.restitution]
value = 0.45
std = 0.05
confidence = "low"
source = "as barley"
[peas.friction]
value = 0.4
std = 0.0
confidence = "low"
source = "as barley"
[peas.rebound_scatter]
value = 0.2
confidence = "low"
source = "as barley"
[peas.impact]
model = "disc"
confidence = "low"
source = "as barley"
"""


def _scene(folder: Path, text: str = PEAS, fraction: str = 'material = "peas"') -> Scene:
    (folder / "mine.toml").write_text(text)
    whole = 'materials = "mine.toml"\n' + (CASES / "rhombus.toml").read_text()
    (folder / "scene.toml").write_text(whole.replace('material = "chaff"', fraction))
    return Scene.load(folder / "scene.toml")


def test_a_fraction_has_the_values_of_its_own_material(tmp_path: Path) -> None:
    peas = _scene(tmp_path).fraction["chaff"]
    assert peas.properties.density == 1100.0
    assert peas.properties.terminal_velocity == 6.2
    assert (peas.properties.friction, peas.properties.rebound_scatter, peas.impact_model) == (0.4, 0.2, "disc")
    spread = peas.coefficients("restitution", np.array([0.5, 0.8413]))
    assert spread is not None
    assert spread == pytest.approx([0.45, 0.50], abs=1e-4)
    assert peas.diameters(np.array([0.5]))[0] == 4.1e-3


def test_what_the_fraction_says_itself_comes_first(tmp_path: Path) -> None:
    peas = _scene(tmp_path, fraction='material = "peas"\ndensity = 1050\nterminal_velocity = "6.5 m/s"')
    assert peas.fraction["chaff"].properties.density == 1050.0
    assert peas.fraction["chaff"].properties.terminal_velocity == 6.5


def test_a_result_tells_the_values_and_not_the_file(tmp_path: Path) -> None:
    scene = _scene(tmp_path)
    assert "materials" not in scene.tables()
    assert Scene.parse(scene.tables()) == scene
    scene.save(tmp_path / "again.toml")
    (tmp_path / "mine.toml").unlink()
    assert Scene.load(tmp_path / "again.toml") == scene


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("density = 1100.0", "", "scene.toml: mine.toml: peas: lacks density"),
        ("density = 1100.0", "densty = 1100.0\ndensity = 1.0", "peas.densty: unknown; did you mean 'density'?"),
        ("density = 1100.0", 'density = "1100 kg/m3"', "needs a number in SI units"),
        ("diameter = 4.1e-3", "diameter = 4.1", "peas.diameter = 4.1: needs a number in SI units from 0 to 0.1"),
        ("std = 0.3\n", "", "peas.terminal_velocity: lacks std"),
        ('confidence = "measured"', 'confidence = "sure"', "write measured, typical, low"),
        ("[peas", "[wheat", "wheat: is a built-in material; give yours another name"),
        ("[peas]", "[peas", "not valid TOML"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(SceneError) as problem:
        _scene(tmp_path, PEAS.replace(old, new))
    assert message in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('materials = "mine.toml"\n' + (CASES / "rhombus.toml").read_text())
    with pytest.raises(SceneError, match=r"mine.toml': No such file"):
        Scene.load(tmp_path / "scene.toml")


def test_all_materials_are_listed_within_the_screen(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["materials"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    starts = [line.split()[0] for line in lines if line.split()]
    assert [name for name in materials if name not in starts] == []


def test_a_material_tells_ranges_sources_and_trust(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials", "wheat"]) == 0
    out = capsys.readouterr().out
    assert "terminal_velocity: 7.8 +- 0.9 m/s (a lot's mean: +- 0.31); measured" in out
    assert "by moisture: 6.81 m/s at 7%, 8.63 m/s at 20%" in out
    (tmp_path / "mine.toml").write_text(PEAS)
    assert main(["materials", "peas", "--file", str(tmp_path / "mine.toml")]) == 0
    assert "our own lot, 2026" in capsys.readouterr().out
    assert main(["materials", "wheet"]) == 2
    assert "did you mean 'wheat'?" in capsys.readouterr().err
