"""What is read from disk is checked: damage is one line that names the file, never a traceback or another number."""

import json
import os
import random
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile import damaged

import wakeflow as wf
from support import begun_part
from wakeflow.air.field import FlowField
from wakeflow.answer.result import FILE, Result, kept_granules, key_in
from wakeflow.core.errors import LONGEST, SceneError
from wakeflow.core.store import Store
from wakeflow.extras.page.document import SceneDocument
from wakeflow.extras.page.stored import points_of
from wakeflow.many.agenda import finished
from wakeflow.many.compute import WIDE
from wakeflow.planning.stage_cache import StageCache, StageTimes, null_listener
from wakeflow.scene import Scene
from wakeflow.scene.measured import read_trays

SEED = 31
Read = Callable[[Path], Any]


def _granules(path: Path) -> Any:
    return {name: values.tolist() for name, values in kept_granules(path.parent).items()}


def _joint(path: Path) -> Any:
    joint = Result.load(path.parent).joint
    return {name: (one.shape, one.tobytes()) for name, one in joint.arrays().items()}


def _field(path: Path) -> Any:
    field = FlowField.load(path)
    return {name: np.asarray(getattr(field, name)).tolist() for name in ("points", "triangles", "velocity", "pressure")}


def _scene(path: Path) -> Any:
    return Scene.load(path).tables()


def _stage(path: Path) -> Any:
    """Of the cache: a damaged stage is made anew, and so what is in it is what was."""
    folder, _ = Store(path.parents[2]).make(path.parents[1].name, path.parent.name, _work)
    return (folder / "data").read_text()


def _work(part: Path) -> None:
    (part / "data").write_text("0.656 of the dust")


READERS: dict[str, Read] = {
    "result.json": lambda path: Result.load(path.parent).table,
    "granules.npz": _granules,
    "joint.npz": _joint,
    "field.npz": _field,
    ".point.json": lambda path: getattr(finished(path.parent, "stamp"), "table", None),
    "manifest.json": _stage,
    "data": _stage,
}


@pytest.fixture(scope="module")
def originals(small_run: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder with each of the files, whole."""
    run = tmp_path_factory.mktemp("damage") / "run"
    run.mkdir()
    for name in ("result.json", "granules.npz", "joint.npz", "SHA256SUMS"):
        shutil.copy(small_run.folder / name, run / name)
    (run / ".point.json").write_text(json.dumps({"stamp": "stamp", "key": key_in(run)}))
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    air = FlowField.from_arrays(points, [[0, 1, 2], [1, 3, 2]], 3.0 * points, np.arange(4.0))
    air.save(run / "field.npz")
    stage, _ = Store(run / "cache").make("tracks", "a" * 64, _work)
    files = {name: run / name for name in ("result.json", "granules.npz", "joint.npz", "field.npz", ".point.json")}
    return files | {name: stage / name for name in ("manifest.json", "data")}


def says_it(problem: SceneError, name: str) -> bool:
    """Whether the line of error names the file, in the room that a line has."""
    assert name in str(problem)
    assert len(str(problem)) <= LONGEST
    return True


def damage(originals: dict[str, Path], name: str, count: int, first: int = 0) -> None:
    """Damage a file ``count`` times: what is read is one line of error or what was written."""
    path, read = originals[name], READERS[name]
    whole, kept, said = path.read_bytes(), read(path), 0
    for number in range(first, first + count):
        content = damaged(whole, random.Random(f"{SEED} {name} {number}"))
        path.write_bytes(content)
        try:
            found = read(path)
        except SceneError as problem:
            said += says_it(problem, path.name)
        except Exception as problem:
            raise AssertionError(f"{name} {number} of seed {SEED}: {type(problem).__name__}: {problem}") from problem
        else:
            assert found == kept or (name == ".point.json" and found is None), f"{name} {number}: another content"
        finally:
            path.write_bytes(whole)
    print(f"seed {SEED}: {name}: {said} of {count} refused, the others unchanged in what they say")


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_one_line_or_what_was_written(originals: dict[str, Path], name: str) -> None:
    damage(originals, name, 60)


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_ten_thousand_damaged_files(originals: dict[str, Path], name: str) -> None:
    damage(originals, name, 1700, first=60)


def test_a_folder_with_a_damaged_result_is_written_anew(small_run: Any, cases: Path, tmp_path: Path) -> None:
    """By the same command, without anything that has to be removed by hand."""
    run = shutil.copytree(small_run.folder, tmp_path / "run")
    for content in (b"\xff\xfe", b"[" * 100_000, b""):
        (run / "result.json").write_bytes(content)
        scene = Scene.parse(dict(small_run.scene))
        assert wf.run(scene, run, report=False).separation == small_run.separation


WRONG = {
    "no share": ("separation.fractions.soft.near", {"value": 1.3, "low": 0.9, "high": 1.4}, "is no share, 0 to 1"),
    "sum": ("separation.fractions.soft.near", {"value": 0.5, "low": 0.4, "high": 0.6}, "sum to"),
    "interval": ("separation.fractions.hard.near", {"value": 0.375, "low": 0.4, "high": 0.6}, "outside of its"),
    "scene": ("scene.fraction", [], "scene.fraction is no table"),
    "fraction": ("scene.fraction.soft", 1, "scene.fraction is no table"),
    "target": ("scene.fraction.soft.target", 1, "target names no bins"),
    "inputs": ("inputs", {}, "is none of the inputs"),
    "bin": ("measure_next.soft", {"nowhere": {}}, "measure_next.soft.nowhere is no share"),
    "of targets": ("of_targets", {"recovery": {}}, "of_targets.recovery is no recovery"),
    "version": ("schema", 2, "is of another version of wakeflow; make it again"),
    "rate": ("separation.throughput.near", -1.0, "is no rate"),
}


@pytest.mark.parametrize("name", WRONG)
def test_numbers_that_cannot_be_are_refused_without_a_checksum_too(name: str, small_run: Any, tmp_path: Path) -> None:
    place, value, words = WRONG[name]
    table = json.loads((small_run.folder / "result.json").read_text())
    del table["sha256"]
    node = table
    *above, last = place.split(".")
    for key in above:
        node = node[key]
    node[last] = value
    (tmp_path / "result.json").write_text(json.dumps(table))
    with pytest.raises(SceneError, match=words):
        Result.load(tmp_path)


GRANULES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "bin beyond": lambda of: of["bin"] + 2,
    "bin before": lambda of: of["bin"] * 0 - 2,
    "bin of parts": lambda of: of["bin"] + 0.5,
    "fraction of parts": lambda of: of["fraction"].astype(float),
    "names of others": lambda of: np.array(["soft", "peas"]),
    "names in rows": lambda of: of["names"][:, None],
    "weight of nothing": lambda of: of["weight"] * 0.0,
    "weight in rows": lambda of: of["weight"][:, None],
    "time of none": lambda of: of["time"][0],
}


@pytest.mark.parametrize("name", GRANULES)
def test_granules_that_cannot_be_are_refused_without_a_checksum_too(name: str, small_run: Any, tmp_path: Path) -> None:
    shutil.copy(small_run.folder / "result.json", tmp_path)
    whole = kept_granules(small_run.folder)
    np.savez(tmp_path / "granules.npz", **(whole | {name.split()[0]: GRANULES[name](whole)}))
    with pytest.raises(SceneError, match=r"granules.npz is damaged; wakeflow report"):
        kept_granules(tmp_path)
    np.savez(tmp_path / "granules.npz", **whole)
    assert set(kept_granules(tmp_path)) == set(whole)


JOINTS: dict[str, Callable[[dict[str, Any], dict[str, Any]], object]] = {  # of the record and the arrays
    "draws of others": lambda record, of: record.update(draws=7),
    "inputs of others": lambda record, of: record.update(inputs=[]),
    "fractions of others": lambda record, of: record.update(fractions=["hard"]),
    "a side of others": lambda record, of: record["on"].update(near="left"),
    "an end that is missing": lambda record, of: record["ends"].pop("near"),
    "an image beyond": lambda record, of: record.update(images=[0, 9]),
    "a source too many": lambda record, of: record["sources"].append({**record["sources"][0], "name": "mesh"}),
    "a source too few": lambda record, of: record["sources"].pop(),
    "no draws": lambda record, of: of.pop("change"),
    "draws in rows": lambda record, of: of.update(z=of["z"].ravel()),
    "draws that are none": lambda record, of: of.update(change=of["change"] * np.nan),
    "words": lambda record, of: of.update(base=np.full(of["base"].shape, "many")),
    "cells too few": lambda record, of: of.update(base=of["base"][:, 1:]),
    "edges too few": lambda record, of: of.update({"edges.floor": of["edges.floor"][1:]}),
    "errors of other bins": lambda record, of: of.update({"root.0": of["root.0"][:, 1:]}),
    "lack of fit of other draws": lambda record, of: of.update({"given.0": of["given.0"][1:]}),
}


@pytest.mark.parametrize("name", JOINTS)
def test_draws_that_cannot_be_are_refused_without_a_checksum_too(name: str, small_run: Any, tmp_path: Path) -> None:
    table = json.loads((small_run.folder / "result.json").read_text())
    del table["sha256"]
    with np.load(small_run.folder / "joint.npz") as kept:
        arrays = dict(kept)
    whole = arrays.copy()
    assert "given.0" in whole
    JOINTS[name](table["joint"], arrays)
    (tmp_path / "result.json").write_text(json.dumps(table))
    np.savez(tmp_path / "joint.npz", **arrays)
    with pytest.raises(SceneError, match=r"damaged; make it again"):
        Result.load(tmp_path).joint.own.separation()
    shutil.copy(small_run.folder / "result.json", tmp_path)
    np.savez(tmp_path / "joint.npz", **whole)
    assert Result.load(tmp_path).joint.own.share("hard", "far") == small_run.share("hard", "far")
    (tmp_path / "joint.npz").unlink()
    with pytest.raises(SceneError, match=r"holds no joint.npz; make it again with: wakeflow run"):
        _ = Result.load(tmp_path).joint


def test_an_archive_that_claims_more_than_it_holds_is_not_unpacked(small_run: Any, tmp_path: Path) -> None:
    shutil.copy(small_run.folder / "result.json", tmp_path)
    for packed in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
        with zipfile.ZipFile(tmp_path / "granules.npz", "w", packed) as archive:
            for name in ("fraction", "weight", "position"):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                    size = 4 * 1024**3 if packed == zipfile.ZIP_STORED else 500_000_000
                    np.lib.format.write_array_header_1_0(
                        stream, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)}
                    )
                    for _ in range(500 if packed == zipfile.ZIP_DEFLATED else 0):
                        stream.write(bytes(1_000_000))
        with pytest.raises(SceneError, match=r"granules.npz (claims to hold more than it may|is damaged)"):
            kept_granules(tmp_path)


def test_a_pickle_in_an_array_is_never_run(small_run: Any, tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(tmp_path / "ran"),)

    shutil.copy(small_run.folder / "result.json", tmp_path)
    np.savez(tmp_path / "granules.npz", names=np.array([Bomb()], dtype=object))
    with pytest.raises(SceneError, match="is damaged"):
        kept_granules(tmp_path)
    with pytest.raises(SceneError, match="is damaged"):
        FlowField.load(tmp_path / "granules.npz")
    assert not (tmp_path / "ran").exists()


TOML = {
    "digits": ("x = " + "9" * 5000, "not valid TOML"),
    "number": ("x = " + "9" * 400, "TOML has 64"),
    "lists": ("x = " + "[" * 3000, "in each other"),
    "tables": ("x = " + "{a=" * 1500 + "1" + "}" * 1500, "in each other"),
    "keys": ("[" + "a." * 3000 + "a]", "in each other"),
    "bracket": ('"[x]" = 1', r"\[x\]: unknown key"),
    "break": ('"con\\n" = 1', r"con\\n: unknown key"),
    "escape": ('"\\u001b[31m" = 1', r"\\x1b\[31m: unknown key"),
    "nothing": ("\x00", "not UTF-8"),
    "many": ("\n".join(f"k{n} = 1" for n in range(100_000)), "more than 80000 keys"),
}


@pytest.mark.parametrize("name", TOML)
def test_a_text_that_is_no_scene_is_one_line(name: str, cases: Path, tmp_path: Path) -> None:
    text, words = TOML[name]
    (tmp_path / "scene.toml").write_text(f"{text}\n{(cases / 'rhombus.toml').read_text()}")
    with pytest.raises(SceneError, match=words) as caught:
        Scene.load(tmp_path / "scene.toml")
    assert len(str(caught.value)) <= LONGEST
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("key", ["scene", "materials", "vibration.samples"])
def test_a_pipe_a_device_and_a_large_file_are_refused_at_once(key: str, cases: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(17_000_000)
    for name, words in {
        "pipe": "is a device or a pipe",
        "/dev/zero": "is a device or a pipe",
        "/proc/self/mem": r"/proc/self/mem: cannot be read \(Input/output error\)",  # as of a damaged disk
        "large": "16 MB",
    }.items():
        path = tmp_path / name  # an absolute name is itself
        with pytest.raises(SceneError, match=words):
            Scene.load(path) if key == "scene" else Scene.load(cases / "rhombus.toml", {key: str(path)})


@pytest.mark.parametrize("read", [read_trays, SceneDocument.load])
def test_a_pipe_and_a_large_file_are_no_trays_and_no_scene_of_a_page(read: Read, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(17_000_000)
    for name, words in {"pipe": "is a device or a pipe", "large": "16 MB"}.items():
        with pytest.raises(SceneError, match=words):
            read(tmp_path / name)


NOTES = ("", "[", "nan", "Infinity", "-1.0", "null", '"5"', "9" * 400, "[" * 100_000)


@pytest.mark.parametrize("text", NOTES)
def test_a_damaged_note_of_the_time_spent_does_not_stop_a_stage_that_goes_on(text: str, tmp_path: Path) -> None:
    part = begun_part(tmp_path, "tracks", "a" * 64)
    (part / "seconds.json").write_text(text)
    cache = StageCache(Store(tmp_path), null_listener, StageTimes())
    cache.make("tracks", "a" * 64, _work)
    assert 0.0 <= cache.seconds["tracks"].seconds < 60.0


TABLES = {
    "foreign": b"name,age\nAda,36\n", "not UTF-8": b"scene,state\n\xff\xfe,done\n", "cut": b"state,scene\ndone\n",
    "long cell": b"scene\n" + b"x" * 200_000, "long name": b"scene\n" + b"x" * 5000, "quote": b'scene\n"a\n\0',
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_a_sweep_that_is_none_is_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / WIDE).write_bytes(TABLES[name])
    if name == "quote":  # a name like any other
        assert [row["run"] for row in points_of(tmp_path)["rows"]] == [False]
        return
    with pytest.raises(SceneError) as caught:
        points_of(tmp_path)
    assert says_it(caught.value, WIDE)


def test_a_table_of_a_sweep_is_read_with_a_bound(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / WIDE)
    with pytest.raises(SceneError, match="is a device or a pipe"):
        points_of(tmp_path)


def test_a_result_that_another_run_left_in_a_sweeps_folder_is_none_of_the_sweep(
    originals: dict[str, Path], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    shutil.copytree(originals[".point.json"].parent, run)
    assert finished(run, "stamp") is not None
    (run / ".point.json").write_text(json.dumps({"stamp": "stamp"}))  # of an earlier version
    assert finished(run, "stamp") is None
    (run / ".point.json").write_text(json.dumps({"stamp": "stamp", "key": key_in(run)}))
    table = json.loads((run / FILE).read_text())
    del table["sha256"]
    (run / FILE).write_text(json.dumps(table | {"key": "0" * 64}))
    assert finished(run, "stamp") is None
