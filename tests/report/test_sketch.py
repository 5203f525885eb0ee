"""The sketch of a machine: every name and measure stands on the paper, and none on another."""

from itertools import combinations
from pathlib import Path

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from support import CASES, shipped
from wakeflow.report.sketch import draw_sketch
from wakeflow.scene import Scene, units_written

FILES = [*CASES.glob("*.toml"), *CASES.glob("paper/*.toml")]
MACHINES = sorted(path for path in FILES if path.stem.partition("-")[0] not in ("sweep", "search"))


def _texts(figure: Figure) -> list[Annotation]:
    return [one for one in figure.axes[0].texts if isinstance(one, Annotation) and one.get_text()]


def _extents(figure: Figure) -> list[tuple[str, Bbox]]:
    """What is written on the paper, and where (pixels), without the arrows that lead from it."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()
    return [(one.get_text(), super(Annotation, one).get_window_extent(canvas.get_renderer())) for one in _texts(figure)]


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_all_is_written_on_the_paper_and_nothing_on_another(path: Path) -> None:
    scene = Scene.load(path)
    figure = draw_sketch(scene)
    written = _extents(figure)
    names = " ".join(text for text, _ in written)
    assert not [name for name in (*scene.body, *scene.bin, *scene.channel.inlet) if name not in names]
    paper = figure.bbox
    assert not [text for text, box in written if not (paper.contains(*box.min) and paper.contains(*box.max))]
    assert not [(one, other) for (one, a), (other, b) in combinations(written, 2) if a.overlaps(b)]


def test_measures_are_the_scenes() -> None:
    written = {one.get_text() for one in _texts(draw_sketch(shipped("rhombus")))}
    assert {"400 mm", "-135", "135", "-200", "air 5 m/s down", "inner-left"} <= written
    assert "feed: 40 mm wide, falls 100 mm\n500 kg/h over a depth of 300 mm" in written
    assert "rhombus: 50 mm x 50 mm, 45 deg\nvibrates at 30 Hz, ± 0.552 mm (2 g)" in written


def test_measures_are_said_in_the_users_units(tmp_path: Path) -> None:
    machine = tmp_path / "machine.toml"
    text = (CASES / "aspirator.toml").read_text().replace("100 mm", "10 cm").replace("200 mm", "20 cm")
    machine.write_text(text.replace("400 mm", "40 cm").replace('"6 m/s"', '"21.6 km/h"'))
    spoken = units_written(machine)
    assert spoken["m"] == "cm"
    written = {one.get_text() for one in _texts(draw_sketch(Scene.load(machine), spoken))}
    assert {"20 cm", "100 cm", "-10", "10"} <= written


def test_a_resting_feed_and_a_side_bin_are_told() -> None:
    tables = shipped("vacuum").tables()
    tables["feed"] = {"start": "resting", "width": 0.02, "count": 32}
    tables["bin"]["wall"] = {"on": "left", "from": -0.1, "to": 0.0}
    written = " ".join(one.get_text() for one in _texts(draw_sketch(Scene.parse(tables))))
    assert "at rest on the body" in written
    assert "bin wall: y -100 mm to 0 mm" in written
