"""What the store keeps: cleaning by age and size, keys of the code that a stage is computed by."""

import errno
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import wakeflow
from wakeflow import Scene
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.air.kinds.analytic import duct_field
from wakeflow.cli import main
from wakeflow.cli.batch import MAX_ROWS, show_stages
from wakeflow.core import code_key
from wakeflow.core.errors import SceneError
from wakeflow.core.files import link_or_copy, write_json
from wakeflow.core.store import (
    TAG,
    KeptStage,
    Store,
    bytes_of,
    cache_in_use,
    kept_stages,
    oldest_beyond,
    remove_stages,
)
from wakeflow.extras.funnel.pour import CODE as POURING
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.runs.planned import make_plan

KEYS = [f"{number}" * 64 for number in range(5)]


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Four stages of 1 MB, the first used longest ago; the second is also shown in a run's folder."""
    store = Store(tmp_path / "cache")
    for number in range(4):

        def work(part: Path, number: int = number) -> None:
            (part / "data").write_bytes(bytes(1_000_000))
            write_json(part / "seconds.json", 10.0 * number)

        folder, _ = store.make("airflow", KEYS[number], work)
        os.utime(folder / "manifest.json", (1e9 + number, 1e9 + number))
    link_or_copy(tmp_path / "cache" / "airflow" / KEYS[1] / "data", tmp_path / "run" / "data")
    return store


def test_stages_are_listed_by_age_with_what_they_cost(store: Store) -> None:
    stages = kept_stages(store.root)
    assert [one.folder.name for one in stages] == KEYS[:4]
    assert [one.seconds for one in stages] == [0.0, 10.0, 20.0, 30.0]
    assert stages[0].size > 1_000_000 > stages[1].size  # a shared file stays on the disk


def test_the_oldest_go_until_little_enough_is_left(store: Store, tmp_path: Path) -> None:
    gone = remove_stages(store.root, oldest_beyond(kept_stages(store.root), 2.1e6))
    assert [one.folder.name for one in gone] == KEYS[:1]
    gone = remove_stages(store.root, oldest_beyond(kept_stages(store.root), 1.1e6))
    assert [one.folder.name for one in gone] == KEYS[1:3]
    assert (tmp_path / "run" / "data").stat().st_size == 1_000_000
    assert [one.folder.name for one in kept_stages(store.root)] == KEYS[3:4]


def test_what_was_used_last_stays_longest(store: Store) -> None:
    """On file systems too that note no reading."""
    store.make("airflow", KEYS[0], lambda part: None)
    assert [one.folder.name for one in kept_stages(store.root)] == [*KEYS[1:4], KEYS[0]]


def test_a_long_list_ends_in_what_it_leaves_out(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    stages = [KeptStage("mesh", tmp_path / f"key{number}", 10**6, 2.0, 1e9 + number) for number in range(MAX_ROWS + 5)]
    show_stages(stages)
    told = capsys.readouterr().out
    assert "5 more" in told
    assert f"{len(stages)} stages" in told


def test_a_stage_that_is_worked_on_stays(store: Store) -> None:
    from filelock import FileLock

    with FileLock(store.root / "airflow" / f"{KEYS[0]}.lock"):
        gone = remove_stages(store.root, kept_stages(store.root))
    assert [one.folder.name for one in gone] == KEYS[1:4]


def test_clean_prints_and_keeps(
    store: Store, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("WAKEFLOW_CACHE", str(store.root))
    assert main(["clean"]) == 0
    out = capsys.readouterr().out
    assert "4 stages" in out
    assert "60 s" in out
    assert main(["clean", "--keep", "1.1MB", "--dry-run"]) == 0
    assert "3 stages would be removed, 2.0 MB would be freed, 30 s to make again" in capsys.readouterr().out
    assert len(kept_stages(store.root)) == 4
    assert main(["clean", "--keep", "1.1MB"]) == 0
    out = capsys.readouterr().out
    assert "3 stages removed, 2.0 MB freed, 30 s to make again" in out
    assert "1 stages" in out
    assert main(["clean", "--keep", "much"]) == 2


def test_what_is_read_stays(store: Store) -> None:
    (store.root / "airflow" / f"{KEYS[4]}.part").mkdir()
    with cache_in_use(store.root):
        gone = remove_stages(store.root, kept_stages(store.root))
    assert [one.folder.name for one in gone] == [f"{KEYS[4]}.part"]
    assert len(kept_stages(store.root)) == 4


def a_home(folder: Path) -> dict[Path, bytes]:
    """A folder that holds what people have; every file with what is in it."""
    manifest = '{"name": "webapp", "version": "1"}'
    texts = {
        "Documents/thesis/thesis.tex": "years", "Downloads/film.part/film": "half", "photos/2020/a.jpg": "a",
        "projects/webapp/manifest.json": manifest, f"store/{KEYS[0]}/data": "theirs", f"store/{KEYS[1]}.part/x": "x",
        f"mesh/{KEYS[2]}/manifest.json": manifest, f"mesh/{KEYS[2]}/data": "theirs", "mesh/notes.txt": "mine",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return {folder / name: text.encode() for name, text in texts.items()}


CLEANING = (["clean"], ["clean", "--everything"], ["clean", "--keep", "0"], ["clean", "--everything", "--yes"])


@pytest.mark.parametrize("words", CLEANING)
def test_a_folder_with_other_things_is_never_cleaned(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = a_home(tmp_path)
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path))
    assert main(words) == 2
    assert "has no mark of wakeflow's cache" in capsys.readouterr().err
    Store(tmp_path).make("tracks", KEYS[3], lambda part: write_json(part / "seconds.json", 1.0))  # a run works there
    assert main(words) == 2
    assert before.items() <= {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}.items()
    assert Store(tmp_path).holds("tracks", KEYS[3])


@pytest.mark.parametrize("words", CLEANING)
def test_what_others_put_into_the_cache_and_what_links_lead_to_stays(
    words: list[str], store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = a_home(store.root) | a_home(tmp_path / "outside")
    (store.root / "link").symlink_to(tmp_path / "outside")
    (store.root / "tracks").symlink_to(tmp_path / "outside" / "store")
    (store.root / "airflow" / KEYS[4]).symlink_to(tmp_path / "outside" / "store" / KEYS[0])
    (store.root / "airflow" / f"{KEYS[4]}.part").symlink_to(tmp_path / "outside" / "photos")
    monkeypatch.setenv("WAKEFLOW_CACHE", str(store.root))
    assert main(words) == 0
    assert before == {path: path.read_bytes() for path in before}
    assert len(kept_stages(store.root)) == (4 if words == ["clean"] else 0)


def test_the_cache_carries_the_mark_that_backups_heed(store: Store) -> None:
    text = (store.root / TAG).read_text()
    assert text.startswith("Signature: 8a477f597d28d172789f06886806bc55\n")
    (store.root / TAG).unlink()  # as caches of earlier versions are: nothing else is in them
    assert len(kept_stages(store.root)) == 4
    assert (store.root / TAG).read_text() == text


@pytest.mark.parametrize(("answer", "left"), [("", 4), ("n", 4), ("y", 0)])
def test_on_a_terminal_the_user_is_asked(
    answer: str, left: int, store: Store, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("WAKEFLOW_CACHE", str(store.root))
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", lambda prompt: answer)
    assert main(["clean", "--everything"]) == 0
    assert len(kept_stages(store.root)) == left
    assert KEYS[0][:12] in capsys.readouterr().out


MANIFESTS = {
    "empty table": b"{}", "not UTF-8": b"\xff\xfe{", "list": b"[]", "number": b"1", "null": b"null", "text": b'"s"',
    "deep": b"[" * 100_000, "long": b"9" * 5000, "empty": b"", "half": b'{"data": "ab', "numbers": b'{"data": 1}',
    "wrong": b'{"data": "%s", "seconds.json": "%s"}' % (b"0" * 64, b"0" * 64), "infinite": b'{"data": Infinity}',
}  # fmt: skip


@pytest.mark.parametrize("name", MANIFESTS)
def test_a_damaged_manifest_vouches_for_nothing(name: str, store: Store) -> None:
    folder = store.root / "airflow" / KEYS[0]
    (folder / "manifest.json").write_bytes(MANIFESTS[name])
    (folder / "data").write_text("changed")
    made, cached = store.make("airflow", KEYS[0], lambda part: (part / "data").write_text("anew"))
    assert not cached
    assert (made / "data").read_text() == "anew"


def test_a_file_that_the_manifest_does_not_list_is_noticed(store: Store) -> None:
    (store.root / "airflow" / KEYS[0] / "more").write_text("?")
    assert not store.holds("airflow", KEYS[0])
    assert store.holds("airflow", KEYS[1])


@pytest.mark.parametrize(
    ("text", "size"), [("10GB", 1e10), ("500 MB", 5e8), ("12 B", 12.0), ("1.5k", 1500.0), ("0", 0.0)]
)
def test_sizes(text: str, size: float) -> None:
    assert bytes_of(text) == size
    with pytest.raises(SceneError, match="no size"):
        bytes_of(f"-{text}")


def test_a_damaged_note_of_the_cost_stops_nothing(store: Store) -> None:
    (store.root / "airflow" / KEYS[1] / "seconds.json").write_text("")
    assert [one.seconds for one in kept_stages(store.root)] == [0.0, None, 20.0, 30.0]


def test_a_size_without_a_unit_is_refused() -> None:
    """Whoever writes 10 means gigabytes, and would lose the whole cache."""
    with pytest.raises(SceneError, match="with its unit"):
        bytes_of("10")


def test_a_link_is_one_file_and_a_copy_where_there_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, target = tmp_path / "a", tmp_path / "b" / "c"
    source.write_text("first")
    link_or_copy(source, target)
    assert target.samefile(source)

    def refuse(*_: object) -> None:
        raise OSError(errno.EXDEV, "another disk")

    monkeypatch.setattr(os, "link", refuse)
    link_or_copy(source, target)
    assert target.read_text() == "first"
    assert not target.samefile(source)
    assert not list(target.parent.glob(".*"))


GIVEN = re.compile(
    r'(?:code_of\(|^(?:    code(?:: ClassVar\[str\])?|CODE|GATHERING) = )((?:"[\w.]+"(?:, )?)+)', re.MULTILINE
)
NAMED = (  # the modules of every key
    tuple(f"wakeflow.{module}" for module in re.findall(r"[\w.]+", given))
    for path in code_key.PACKAGE.rglob("*.py") for given in GIVEN.findall(path.read_text())
)  # fmt: skip
CODE = {modules[0].rpartition(".")[2]: modules for modules in NAMED}  # by the first of them
STAGES = {**CODE, "kernel": ("wakeflow.flight.kernel.loop",)}


SOME = 3  # modules of a stage that are touched: its key reads all of them each time


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the sources that may be edited; keys are made of it."""
    root = tmp_path / "wakeflow"
    shutil.copytree(code_key.PACKAGE, root, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(code_key, "PACKAGE", root)
    _read_again()
    yield root
    _read_again()


def _read_again() -> None:
    code_key.package_key.cache_clear()
    code_key.code_key.cache_clear()


@pytest.mark.parametrize("stage", STAGES)
def test_touching_any_module_of_the_closure_changes_the_key(stage: str, copied: Path) -> None:
    before = code_key.code_key(*STAGES[stage])
    closure = code_key.closure(*STAGES[stage])
    assert set(STAGES[stage]) <= closure
    for module in sorted(closure)[:: max(1, len(closure) // SOME)]:  # other ones for every stage
        base = copied.joinpath(*module.split(".")[1:])
        path = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
        text = path.read_text()
        path.write_text(f"{text}# touched\n")
        _read_again()
        assert code_key.code_key(*STAGES[stage]) != before, module
        path.write_text(text)
    _read_again()
    assert code_key.code_key(*STAGES[stage]) == before


def test_what_no_stage_runs_leaves_its_key_alone(copied: Path) -> None:
    before = code_key.code_key(*CODE["airflow"])
    for name in ("cli/run.py", "flight/stages/fraction_flights.py"):
        (copied / name).write_text("")
    _read_again()
    assert code_key.code_key(*CODE["airflow"]) == before


def test_data_files_of_the_funnel_enter_its_key(copied: Path) -> None:
    before = code_key.code_key(*POURING)
    (copied / "extras" / "funnel" / "settle.liggghts").write_text("")
    _read_again()
    assert code_key.code_key(*POURING) != before


def _ran(work: Callable[[], object]) -> set[str]:
    """Modules of the package whose code runs in ``work``."""
    ran: set[str] = set()

    def note(frame: FrameType, event: str, argument: Any) -> None:
        ran.add(frame.f_globals.get("__name__", ""))

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return {module for module in ran if module.startswith("wakeflow.")}


def test_modules_that_run_while_granules_fly_stand_in_the_closure(cases: Path, tmp_path: Path) -> None:
    scene = Scene.load(cases / "vacuum.toml").replace({"feed.count": 16})
    flight = Flight(scene, make_plan(scene), Realisations(None), 1e-4)
    own = _ran(lambda: flight.fly_all(tmp_path, drawn=True))
    assert {"wakeflow.flight.stages.fraction_flights", "wakeflow.planning.plan", "wakeflow.laws.collision"} <= own
    assert own <= code_key.closure(*CODE["fraction_flights"])


def test_modules_that_run_while_a_duct_is_made_stand_in_the_closure(cases: Path) -> None:
    scene = Scene.load(cases / "aspirator.toml")
    own = _ran(lambda: duct_field(scene, turbulent=True))
    assert {"wakeflow.air.kinds.analytic", "wakeflow.air.field.flow"} <= own
    assert own <= code_key.closure(*CODE["analytic"])


def test_the_keys_of_all_stages_are_found_by_their_modules() -> None:
    assert set(CODE) == {
        "spec", "airflow", "span_run", "case_field", "analytic", "user_case", "combined", "gathered_force",
        "fraction_flights", "slab_stage", "input_samples", "film_stage", "vtk", "figures",
    }  # fmt: skip


def test_a_name_that_is_no_module_is_refused() -> None:
    with pytest.raises(ModuleNotFoundError, match="nowhere is no module of wakeflow"):
        code_key.closure("wakeflow.nowhere")


def test_what_a_package_registers_as_it_is_imported_counts() -> None:
    tracks = code_key.closure(*CODE["fraction_flights"])
    assert {"wakeflow.laws.forces.records", "wakeflow.laws.forces.history_force"} <= tracks


def test_names_of_a_package_lead_to_their_modules_only() -> None:
    assert "wakeflow.air.field.flow" in code_key.closure("wakeflow.air.field")
    assert "wakeflow.air.foam.solver" not in code_key.closure("wakeflow.air.foam.read")
    assert Path(wakeflow.__file__).parent == code_key.PACKAGE
