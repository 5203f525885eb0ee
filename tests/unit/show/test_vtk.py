"""What ParaView opens, read back by others than its writer: meshio, and a reader of VTK's XML written for this test."""

import base64
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from support import field_of, shipped
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.cli import main
from wakeflow.core.record import from_json
from wakeflow.extras.motion.window import look
from wakeflow.flight import Fate
from wakeflow.scene import Scene
from wakeflow.show.canvas import BODY, fraction_colours
from wakeflow.show.vtk import write_field, write_landings, write_machine, write_moving, write_tracks

LEVEL, PERIOD, FIRST = 3.0, 0.5, 0.25  # Pa, s, s
AIRFLOW = from_json(Airflow, {"rung": "draft", "verdict": "steady", "p_inlet": LEVEL})
TYPES = {"Float32": "f4", "Float64": "f8", "Int32": "i4", "Int64": "i8", "UInt8": "u1", "UInt32": "u4", "UInt64": "u8"}
TIME = np.array([5.1, 5.2, 5.3])
FALL = np.column_stack([0.01 * np.ones(3), 0.1 - 2.0 * (TIME - TIME[0])])


def _values(array: ElementTree.Element, root: ElementTree.Element) -> NDArray[Any]:
    """The numbers of a DataArray: base64 of blocks compressed by zlib, after a header that says their sizes."""
    text, head = (array.text or "").strip(), np.dtype(TYPES[root.attrib["header_type"]])
    assert array.attrib["format"] == "binary"
    count = int(np.frombuffer(base64.b64decode(text[:16])[: head.itemsize], head)[0])
    length = 4 * -(-(3 + count) * head.itemsize // 3)  # letters of the header
    sizes = np.frombuffer(base64.b64decode(text[:length]), head)[3:]
    packed, found, at = base64.b64decode(text[length:]), b"", 0
    for size in sizes.tolist():
        found += zlib.decompress(packed[at : at + size])
        at += size
    flat = np.frombuffer(found, TYPES[array.attrib["type"]])
    wide = int(array.attrib.get("NumberOfComponents", 1))
    return flat.reshape(-1, wide) if wide > 1 else flat


def _words(array: ElementTree.Element, root: ElementTree.Element) -> list[str]:
    letters = ElementTree.Element("DataArray", {**array.attrib, "type": "UInt8"})
    letters.text = array.text
    return [word.decode() for word in _values(letters, root).tobytes().split(b"\0")[:-1]]


def _read(path: Path) -> dict[str, Any]:
    """Points, lines as lists of indices, and the arrays of points, cells and the whole file, of a .vtp."""
    root = ElementTree.parse(path).getroot()
    data = root.find("PolyData")
    piece = data.find("Piece")
    found: dict[str, Any] = {"point": {}, "cell": {}, "names": {}, "numbers": {}}
    for where, part in (("point", piece.find("PointData")), ("cell", piece.find("CellData"))):
        for array in [] if part is None else part:
            found[where][array.attrib["Name"]] = _values(array, root)
    for array in data.findall("FieldData/*"):
        kind, read = ("names", _words) if array.attrib["type"] == "String" else ("numbers", _values)
        found[kind][array.attrib["Name"]] = read(array, root)
    place = piece.find("Points/DataArray")
    found["points"] = np.zeros((0, 3)) if place is None else _values(place, root)
    for kind in ("Lines", "Verts", "Polys"):
        arrays = {array.attrib["Name"]: array for array in piece.findall(f"{kind}/DataArray")}
        ends = _values(arrays["offsets"], root) if int(piece.attrib[f"NumberOf{kind}"]) else np.zeros(0, dtype=int)
        found[kind] = np.split(_values(arrays["connectivity"], root), ends[:-1]) if len(ends) else []
    return found


def _turning(rate: float) -> FlowField:
    """Air that turns like a wheel: its vorticity is twice the ``rate`` (1/s); pressure grows upward."""
    field = field_of(lambda x: rate * np.stack([-x[:, 1], x[:, 0]], axis=1))
    return replace(field, pressure=LEVEL + field.points[:, 1], k=np.full(len(field.points), 0.5))


def _in_time() -> FlowField:
    """Air that turns at 2, 4 and 6 1/s at three moments of its loop."""
    steady, rates = _turning(2.0), np.array([1.0, 2.0, 3.0])
    return replace(
        steady, velocity=rates[:, None, None] * steady.velocity, pressure=np.tile(steady.pressure, (3, 1)),
        k=np.tile(steady.k, (3, 1)), times=FIRST + PERIOD / 3 * np.arange(3), period=PERIOD,
    )  # fmt: skip


def _series(path: Path) -> list[tuple[float, Path]]:
    rows = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    return [(float(row.attrib["timestep"]), path.parent / row.attrib["file"]) for row in rows]


def _tracks(scene: Scene) -> dict[str, list[dict[str, Any]]]:
    """A track of the first fraction, one of a single point of the second."""
    first, second = list(scene.fraction)[:2]
    velocity = np.tile([0.0, -2.0], (3, 1))
    fell = {"time": TIME, "position": FALL, "velocity": velocity, "arriving": velocity}
    stood = {name: values[:1] for name, values in fell.items()}
    ends = {"diameter": np.array(1e-3), "bin": np.array(1), "fate": np.array(int(Fate.BINNED))}
    return {first: [{**fell, **ends}], second: [{**stood, **ends, "bin": np.array(-1)}]}


def test_meshio_reads_steady_air(rhombus: Scene, tmp_path: Path) -> None:
    scene, field = rhombus, _turning(2.0)
    path = write_field(tmp_path, field, scene, AIRFLOW)
    assert path.name == "field.vtu"
    mesh = meshio.read(path)
    assert np.array_equal(mesh.cells_dict["triangle"], field.triangles)
    assert mesh.points[:, :2] == pytest.approx(field.points, abs=1e-6)
    assert mesh.point_data["velocity (m/s)"][:, :2] == pytest.approx(_shown(field, scene), abs=1e-6)
    assert mesh.point_data["pressure (Pa)"] == pytest.approx(field.pressure, abs=1e-6)
    dynamic = 0.5 * field.density * scene.air.speed**2
    assert mesh.point_data["Cp"] == pytest.approx(field.points[:, 1] / dynamic, abs=1e-6)
    assert mesh.point_data["k (m2/s2)"] == pytest.approx(0.5)
    assert mesh.field_data["pressure at the inlet (Pa)"] == pytest.approx([LEVEL])


def test_air_in_time_is_written_at_as_many_moments_as_are_asked_for(rhombus: Scene, tmp_path: Path) -> None:
    scene, field = rhombus.replace({"numerics.snapshots": 6}), _in_time()
    series = _series(write_field(tmp_path, field, scene, AIRFLOW))
    assert [time for time, _ in series] == pytest.approx(FIRST + PERIOD / 6 * np.arange(6))
    for (_, file), rate in zip(series, (2, 3, 4, 5, 6, 4), strict=True):
        mesh = meshio.read(file)
        assert mesh.point_data["vorticity (1/s)"] == pytest.approx(2.0 * rate, rel=1e-4)
        assert np.hypot(*mesh.point_data["velocity (m/s)"][:, :2].T) == pytest.approx(
            rate * np.hypot(*field.points.T), abs=1e-5
        )
    mean = meshio.read(tmp_path / "mean.vtu")  # of the flow and its image, which turns the other way
    assert mean.point_data["Cp"] == pytest.approx(meshio.read(series[0][1]).point_data["Cp"], abs=1e-5)
    write_field(tmp_path, field, scene.replace({"numerics.snapshots": 0}), AIRFLOW)
    assert {path.name for path in tmp_path.iterdir()} == {"mean.vtu", "field.npz"}


def test_the_mesh_stands_where_it_swings_to(rhombus: Scene, tmp_path: Path) -> None:
    field = _in_time().moving((0.0, 0.01), 2 * np.pi / PERIOD)
    series = _series(write_field(tmp_path, field, rhombus.replace({"numerics.snapshots": 4}), AIRFLOW))
    ups = [float((meshio.read(file).points[:, 1] - field.points[:, 1]).mean()) for _, file in series]
    assert ups == pytest.approx([0.0, -0.01, 0.0, 0.01], abs=1e-6)  # from half of a swing on


def _shown(field: FlowField, scene: Scene) -> NDArray[Any]:
    """A steady field as it is written: in a machine that is its own image, the mean of both, where both are."""
    from wakeflow.show.air_pictures import as_flown

    return np.asarray(as_flown(field, scene).velocity)


def test_tracks_say_whose_they_are_and_how_they_lie_in_the_loop(rhombus: Scene, tmp_path: Path) -> None:
    found = _read(write_tracks(tmp_path, _tracks(rhombus), rhombus, _in_time()))
    first, second = list(rhombus.fraction)[:2]
    assert [len(line) for line in found["Verts"]] == [1]
    assert [len(line) for line in found["Lines"]] == [3]
    fell = found["Lines"][0]
    assert found["points"][fell][:, :2] == pytest.approx(FALL, abs=1e-7)
    assert found["point"]["time since release (s)"][fell] == pytest.approx([0.0, 0.1, 0.2], abs=1e-6)
    assert found["point"]["loop time (s)"][fell] == pytest.approx([0.6, 0.7, 0.3], abs=1e-6)  # of 0.25 to 0.75
    assert found["point"]["speed (m/s)"] == pytest.approx(2.0)
    cell, shares = found["cell"], rhombus.mass_shares()
    assert cell["release (s)"] == pytest.approx(5.1)
    assert cell["weight"] == pytest.approx([shares[second], shares[first]])
    assert cell["diameter (m)"] == pytest.approx(1e-3)
    assert [found["names"]["fraction_names"][i] for i in cell["fraction"]] == [second, first]
    assert cell["bin"].tolist() == [-1, 1]
    assert found["names"]["bin_names"] == list(rhombus.bin)
    assert {found["names"]["fate_names"][i] for i in cell["fate"]} == {"binned"}


def test_granules_are_where_they_are_at_each_moment_of_the_loop(rhombus: Scene, tmp_path: Path) -> None:
    scene, field = rhombus.replace({"numerics.snapshots": 10}), _in_time()
    series = _series(write_moving(tmp_path, _tracks(scene), scene, field) or tmp_path)
    air = [time for time, _ in _series(write_field(tmp_path, field, scene, AIRFLOW))]
    assert [time for time, _ in series] == air
    shown = {round(time, 6): _read(file) for time, file in series}
    there = [time for time, found in shown.items() if len(found["points"])]
    assert there == [0.25, 0.6, 0.65, 0.7]  # the loop is 0.25 to 0.75; it flies from 5.1 to 5.3
    later = shown[0.65]
    assert later["points"][0, :2] == pytest.approx([0.01, 0.0], abs=1e-6)
    assert later["point"]["time since release (s)"] == pytest.approx([0.05], abs=1e-6)
    assert write_moving(tmp_path, _tracks(scene), scene, None) is None
    assert not (tmp_path / "granules").exists()


def test_landings_are_points(rhombus: Scene, tmp_path: Path) -> None:
    columns = {
        "fraction": np.array([0, 1]), "position": np.array([[0.1, -0.2], [0.0, -0.2]]), "bin": np.array([2, -1]),
        "weight": np.array([0.25, 0.5]), "diameter": np.array([1e-3, 2e-3]), "time": np.array([0.3, 0.4]),
        "fate": np.array([int(Fate.BINNED), int(Fate.ESCAPED)]), "impacts": np.array([1, 0]),
    }  # fmt: skip
    found = _read(write_landings(tmp_path, columns, rhombus))
    assert found["points"][:, :2] == pytest.approx(columns["position"])
    assert [found["names"]["fate_names"][i] for i in found["point"]["fate"]] == ["binned", "escaped"]
    names = {"bin": "bin", "weight": "weight", "diameter (m)": "diameter", "time in flight (s)": "time"}
    for name, column in names.items():
        assert found["point"][name] == pytest.approx(columns[column])


def test_nothing_is_an_empty_file(rhombus: Scene, tmp_path: Path) -> None:
    assert len(_read(write_tracks(tmp_path, {}, rhombus))["points"]) == 0
    none = {name: np.zeros(0) for name in ("fraction", "bin", "weight", "fate", "diameter", "time", "impacts")}
    assert len(_read(write_landings(tmp_path, {**none, "position": np.zeros((0, 2))}, rhombus))["points"]) == 0


def test_the_machine_is_blocks_with_the_scenes_names(tmp_path: Path) -> None:
    scene = shipped("rhombus")
    root = ElementTree.parse(write_machine(tmp_path, scene)).getroot()
    blocks = {
        group.attrib["name"]: {one.attrib["name"]: _read(tmp_path / one.attrib["file"]) for one in group}
        for group in root.findall("vtkMultiBlockDataSet/Block")
    }
    assert list(blocks["bodies"]) == list(scene.body)
    assert list(blocks["bins"]) == list(scene.bin)
    assert set(blocks["walls"]) == {"left", "right"}
    for name, body in scene.body.items():
        found = blocks["bodies"][name]
        assert found["points"][found["Polys"][0]][:, :2] == pytest.approx(body.outline(), abs=1e-6)
        assert found["numbers"]["frequency (Hz)"] == pytest.approx([1.0 / scene.vibration.period])
    for name, bin_ in scene.bin.items():
        assert blocks["bins"][name]["points"][:, :2] == pytest.approx(bin_.line(scene), abs=1e-6)


SIDES = {"soft": np.array([1.0, 1.0]), "hard": np.array([-1.0, 1.0])}  # of the vacuum scene: to the right, to the left


def _pixels(path: Path, colour: str) -> NDArray[np.bool_]:
    """Where a picture has a colour, to within what smoothing of edges does."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.abs(np.asarray(Image.open(path).convert("RGB")).astype(int) - wanted).max(axis=2) < 12


def test_a_run_shows_its_bodies_and_its_tracks(tmp_path: Path) -> None:
    scene, picture = shipped("vacuum"), tmp_path / "window.png"
    time, x = np.linspace(3.0, 3.4, 30), np.linspace(0.0, 0.25, 30)
    fall = np.column_stack([x, 0.1 - 3.0 * x**2])
    ends = {"diameter": np.array(1e-3), "bin": np.array(0), "fate": np.array(0)}
    paths = {
        name: [{"time": time, **dict.fromkeys(("position", "velocity", "arriving"), side * fall), **ends}]
        for name, side in SIDES.items()
    }
    write_tracks(tmp_path, paths, scene)
    look(scene, tmp_path, picture)
    between = _pixels(picture, BODY)[200:650, 400:800]  # of walls, legend and bins, whose edges have all greys
    left, middle, right = np.quantile(np.argwhere(between)[:, 1], [0.05, 0.5, 0.95])
    assert middle == pytest.approx(200, abs=5)  # the prism stands on the axis, in the middle of 1200 pixels
    assert 45 < right - left < 90  # 50 mm are 89 pixels
    for name, colour in fraction_colours(list(SIDES)).items():
        drawn = np.argwhere(_pixels(picture, colour)[200:])[:, 1]
        assert (drawn.mean() > 600) == (SIDES[name][0] > 0)


def test_a_scene_shows_its_machine_alone(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    scene = tmp_path / "machine.toml"
    scene.write_text((cases / "vacuum.toml").read_text())
    assert main(["view", str(scene)]) == 0
    picture = tmp_path / "machine-view.png"
    assert capsys.readouterr().out.startswith(
        "no screen for a window (neither DISPLAY nor WAYLAND_DISPLAY is set); drawn instead: "
    )
    assert _pixels(picture, BODY).any()
    assert not _pixels(picture, fraction_colours(["soft"])["soft"]).any()


def test_the_picture_of_a_window_is_a_png(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(cases / "vacuum.toml"), "--picture", "machine.svg"]) == 2
    assert "is a PNG" in capsys.readouterr().err
