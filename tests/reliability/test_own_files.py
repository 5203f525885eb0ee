"""What a run leaves is its own: no file of others is replaced or removed, no link is followed, nothing is left over."""

import csv
import errno
import importlib
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import wakeflow as wf
from support import shipped
from wakeflow.answer.result import Result
from wakeflow.cli import main
from wakeflow.core import own_files
from wakeflow.core.errors import SceneError
from wakeflow.core.files import atomic_write, digest_of, write_json
from wakeflow.core.tables import CellTable
from wakeflow.extras.motion.film import BEGIN, END, show_film
from wakeflow.scene import Scene
from wakeflow.scene.changes import run_folder


@pytest.fixture
def run(small_run: Any, tmp_path: Path) -> Path:
    """A finished run's folder that may be changed."""
    return shutil.copytree(small_run.folder, tmp_path / "run", symlinks=True)


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """A folder of somebody's with a picture of the name that a report gives one."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "landing.png").write_text("a photo")
    return tmp_path / "mine"


@pytest.mark.parametrize("command", ["run", "report", "animate", "bins", "sensitivity", "sweep"])
def test_a_link_in_the_folder_of_results_is_not_followed(
    command: str, run: Path, theirs: Path, cases: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(run / "figures")
    (run / "figures").symlink_to(theirs)
    words = {
        "run": ["run", str(cases / "vacuum.toml"), "--set", "feed.count=16", "--out", str(run)],
        "report": ["report", str(run)],
        "animate": ["animate", str(run)],
        "bins": ["bins", str(run), "--purity", "soft"],
        "sensitivity": ["sensitivity", str(run)],
        "sweep": ["sweep", str(cases / "vacuum.toml"), "--set", "feed.count=16", "--out", str(run)],
    }
    assert main(words[command]) == 2
    assert "figures is a link to a folder; remove the link" in capsys.readouterr().err
    assert [path.name for path in theirs.iterdir()] == ["landing.png"]
    assert (theirs / "landing.png").read_text() == "a photo"


def test_every_file_of_a_run_is_listed_with_its_checksum(small_run: Any) -> None:
    folder = small_run.folder
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert found - set(own_files.listed(folder)) == {".lock", "SHA256SUMS"}
    done = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=folder, check=False)
    assert done.returncode == 0


@pytest.mark.parametrize("name", ["separation.csv", "figures/landing.png", "granules.npz", "machine/bins_00.vtp"])
def test_a_file_that_no_run_wrote_is_not_replaced(name: str, tmp_path: Path) -> None:
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    with pytest.raises(SceneError, match=r"holds .*, which no run of wakeflow wrote"):
        wf.run(shipped("vacuum", {"feed.count": 16}), tmp_path / "out")
    assert path.read_text() == "mine"


def test_a_lock_or_a_list_of_another_program_lets_nothing_be_replaced(tmp_path: Path) -> None:
    for name in (".lock", "separation.csv"):
        (tmp_path / name).write_text("mine")
    with pytest.raises(SceneError, match=r"holds separation.csv, which no run of wakeflow wrote"):
        wf.run(shipped("vacuum", {"feed.count": 16}), tmp_path)
    (tmp_path / "separation.csv").rename(tmp_path / "sweep.csv")
    with pytest.raises(SceneError, match=r"holds sweep.csv, which no run of wakeflow wrote"):
        wf.sweep([shipped("vacuum")], tmp_path)


def test_what_others_put_into_the_folders_of_a_report_stays_theirs(run: Path) -> None:
    """A state of ParaView's beside the field, say: the next run and the next report draw around it."""
    own = [run / name for name in ("machine/notes.txt", "field/my.pvsm", "granules/a.txt", "figures/film.notes")]
    for path in own:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    wf.run(shipped("vacuum", {"feed.count": 16}), run)
    main(["report", str(run)])
    assert [path.read_text() for path in own] == ["mine"] * 4
    assert not {path.relative_to(run).as_posix() for path in own} & set(own_files.listed(run))
    assert (run / "machine" / "bins_00.vtp").exists()


def test_a_killed_run_is_gone_on_from_and_a_failed_one_excuses_nothing(run: Path, small_run: Any) -> None:
    (run / "SHA256SUMS").unlink()
    (run / "result.json").unlink()
    (run / f"{own_files.BEGUN}run").touch()  # killed while it wrote
    wf.run(Scene.parse(dict(small_run.scene)), run)
    assert not list(run.glob(f"{own_files.BEGUN}*"))
    before = own_files.listed(run)
    (run / "granules.npz").write_bytes(b"damaged")
    (run / "new.csv").write_text("1")
    written = [run / "new.csv", run / "granules.npz"]
    with pytest.raises(ValueError, match="on the way"), own_files.writing(run, lambda: written, "some"):
        raise ValueError("on the way")
    after = own_files.listed(run)
    assert after.pop("new.csv")
    assert after == before
    assert not list(run.glob(f"{own_files.BEGUN}*"))


def _killed(words: list[str]) -> None:
    """A command that is killed when it has written its files."""
    own_files.note = lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL)  # type: ignore[assignment]
    main(words)


def test_a_killed_command_excuses_its_own_files_alone(run: Path) -> None:
    """And it goes on after others have written there meanwhile."""
    bins, table = ["bins", str(run), "--purity", "soft"], run / "sensitivity.csv"
    child = multiprocessing.get_context("spawn").Process(target=_killed, args=(bins,))
    child.start()
    child.join(100)
    assert child.exitcode == -signal.SIGKILL
    table.write_text("mine")
    (run / "figures" / "film.gif").write_text("mine")
    assert main(["sensitivity", str(run)]) == 2
    with pytest.raises(SceneError, match=r"film.gif"):
        wf.run(shipped("vacuum", {"feed.count": 16}), run)
    assert [table.read_text(), (run / "figures" / "film.gif").read_text()] == ["mine", "mine"]
    (run / "figures" / "film.gif").unlink()
    assert main(["animate", str(run), "--seconds", "1", "--size", "240", "--span", "100 ms", "--quiet"]) == 0
    assert main(bins) == 0
    assert not list(run.glob(f"{own_files.BEGUN}*"))


def test_a_killed_command_has_not_changed_the_form_that_it_wrote(tmp_path: Path) -> None:
    form = tmp_path / "measured.csv"
    for text in ("one", "two"):  # killed before it was noted
        own_files.refuse_changed(form, "protocol")
        with own_files.replacing(form, "protocol") as draft:
            draft.write_text(text)
        assert form.read_text() == text
    own_files.refuse_changed(form, "protocol")
    form.write_text("filled in")
    with pytest.raises(SceneError, match="not as the program wrote it"):
        own_files.refuse_changed(form, "protocol")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".begun-protocol", "measured.csv"]


def test_a_list_of_checksums_that_the_user_made_stays(run: Path, small_run: Any, tmp_path: Path) -> None:
    (tmp_path / "compare.csv").write_text("mine")
    own = f"{digest_of(tmp_path / 'compare.csv')}  compare.csv\n"
    (tmp_path / "SHA256SUMS").write_text(own)
    for _ in "with it", "without a file that is replaced":
        with pytest.raises(SceneError, match="holds SHA256SUMS, which no run of wakeflow wrote"):
            wf.compare([small_run, run]).write(tmp_path)
        (tmp_path / "compare.csv").unlink(missing_ok=True)
    assert (tmp_path / "SHA256SUMS").read_text() == own


def test_a_link_that_leads_nowhere_is_not_replaced_or_written_through(tmp_path: Path, run: Path) -> None:
    link = tmp_path / "own.toml"
    link.symlink_to("away")
    for words in (["new", "vacuum", str(link)], ["materials", "--new", str(link)]):
        assert main(words) == 2
    (run / f"{own_files.BEGUN}bins-soft-floor").symlink_to(tmp_path / "away")
    assert main(["bins", str(run), "--purity", "soft"]) == 2
    with pytest.raises(SceneError, match="not as the program"):
        own_files.refuse_changed(link, "protocol")
    assert link.is_symlink()
    assert not (tmp_path / "away").exists()


def test_a_sweep_into_a_folder_that_a_link_leads_to_is_refused(run: Path, theirs: Path) -> None:
    (run / "sensitivity").symlink_to(theirs)
    assert main(["sensitivity", str(run), "--over", "fraction.hard.restitution=0.45,0.55"]) == 2
    assert [path.name for path in theirs.iterdir()] == ["landing.png"]


def test_a_page_that_no_run_wrote_takes_no_film(small_run: Any, tmp_path: Path) -> None:
    wf.run(Scene.parse(dict(small_run.scene)), tmp_path, report=False)
    (tmp_path / "report.html").write_text("mine")
    assert main(["animate", str(tmp_path), "--seconds", "1", "--size", "240", "--span", "100 ms", "--quiet"]) == 0
    assert main(["report", str(tmp_path)]) == 2
    assert (tmp_path / "report.html").read_text() == "mine"


@pytest.mark.parametrize(
    ("command", "said"),
    [("animate", "holds another answer now; the same command"), ("calibrate", "another run is writing to")],
)
def test_what_is_made_of_one_answer_is_not_laid_beside_another(
    command: str,
    said: str,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """As where another process runs another scene into the folder meanwhile; a calibration does not let it."""
    trays, scene = tmp_path / "trays.csv", tmp_path / "scene.toml"
    Scene.parse(Result.load(run).scene).save(scene)
    trays.write_text("fraction,bin,share,uncertainty\nhard,far,0.6,0.05\n")
    small = ["--seconds", "1", "--size", "240", "--span", "100 ms", "--quiet"]
    words, way = {
        "animate": ([str(run), *small], "wakeflow.extras.motion.film.write_film"),
        "calibrate": ([str(scene), str(trays), "--out", str(run)], "wakeflow.extras.trays.calibration._posterior"),
    }[command]
    module, name = way.rpartition(".")[::2]
    real = getattr(importlib.import_module(module), name)

    def meanwhile(*given: Any, **how: Any) -> object:
        wf.run(shipped("vacuum", {"feed.count": 16}), run)
        return real(*given, **how)

    monkeypatch.setattr(way, meanwhile)
    assert main([command, *words]) == 2
    assert said in capsys.readouterr().err
    assert not (run / "figures" / "film.gif").exists()
    assert not (run / "inputs.csv").exists()


def test_a_traceback_does_not_replace_a_file_of_that_name(tmp_path: Path) -> None:
    folder = tmp_path / "feed.count=16"
    folder.mkdir()
    (folder / "failure.log").write_text("mine")
    done = wf.sweep(wf.variants(shipped("vacuum"), {"feed.count": [16, 32]}), tmp_path, workers=1, figures=False)
    assert "holds failure.log" in done.failed["feed.count=16"]
    assert (folder / "failure.log").read_text() == "mine"


def test_a_picture_replaces_a_link_and_not_what_it_leads_to(cases: Path, tmp_path: Path) -> None:
    (tmp_path / "photo.png").write_text("a photo")
    (tmp_path / "link.png").symlink_to("photo.png")
    assert main(["view", str(cases / "vacuum.toml"), "--picture", str(tmp_path / "link.png")]) == 0
    assert (tmp_path / "photo.png").read_text() == "a photo"
    assert (tmp_path / "link.png").read_bytes().startswith(b"\x89PNG")


def test_damaged_tracks_are_not_shown(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / "tracks.vtp").write_bytes((run / "tracks.vtp").read_bytes().replace(b"since", b"sinse", 1) + b" ")
    assert main(["view", str(run), "--picture", str(tmp_path / "p.png")]) == 2
    assert "tracks.vtp is damaged" in capsys.readouterr().err


def test_a_disk_that_is_full_is_told_with_the_folder(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=re.escape(str(tmp_path))), own_files.writing(tmp_path, list, "some"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # as write() says it: without a name


@pytest.mark.parametrize("what", ["compare", "sweep", "sensitivity"])
def test_a_figure_or_a_table_of_others_is_not_replaced(what: str, run: Path, small_run: Any, tmp_path: Path) -> None:
    other = wf.run(Scene.parse(dict(small_run.scene)).replace({"feed.height": 0.12}), tmp_path / "other", report=False)
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    names = ["figures/trade-off.png", "figures/lines-feed.height.png", "figures/sensitivity.png", "sensitivity.csv"]
    for name in names:
        (out / name).write_text("mine")
    (out / "result.json").write_text("{}")  # of another program
    ways = {
        "compare": lambda: wf.compare([small_run, other]).write(out),
        "sweep": lambda: wf.sweep(
            wf.variants(shipped("vacuum", {"feed.count": 16}), {"feed.height": [0.1, 0.12]}), out
        ),
        "sensitivity": lambda: wf.sensitivity(run, out),
    }
    with pytest.raises(SceneError, match="which no run of wakeflow wrote"):
        ways[what]()
    assert [(out / name).read_text() for name in names] == ["mine"] * 4


def test_a_damaged_film_is_left_out_of_the_report(run: Path) -> None:
    (run / "figures" / "film.gif").write_bytes(b"GIF89a")
    own_files.note(run, [run / "figures" / "film.gif"])
    assert main(["report", str(run)]) == 0
    assert "film.gif cannot be read here" in (run / "report.html").read_text()


def test_a_pipe_in_the_place_of_granules_is_not_waited_for(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / "granules.npz").unlink()
    os.mkfifo(run / "granules.npz")
    assert main(["bins", str(run), "--purity", "soft"]) == 2
    assert "holds no granules.npz" in capsys.readouterr().err
    with pytest.raises(SceneError, match=r"granules.npz is no file"):
        own_files.check(run, "granules.npz", "")


def test_a_page_with_a_byte_that_is_not_utf8_takes_a_film(run: Path) -> None:
    (run / "report.html").write_bytes(f"{BEGIN}{END}".encode() + b"\xff")
    (run / "film.gif").write_bytes(b"GIF89a")
    show_film(run, run / "film.gif")
    assert (run / "report.html").read_bytes().endswith(b"\xff")
    assert b"film.gif" in (run / "report.html").read_bytes()


def test_a_folder_whose_name_is_not_utf8_is_refused_or_read(run: Path, small_run: Any, tmp_path: Path) -> None:
    odd = shutil.copytree(run, os.fsdecode(os.fsencode(tmp_path) + b"/o\xff"))
    with pytest.raises(SceneError, match="its name is not UTF-8; choose another --out"):
        wf.run(shipped("vacuum", {"feed.count": 16}), odd)
    wf.compare([small_run, odd]).write(tmp_path / "both")
    assert "o?" in (tmp_path / "both" / "compare.csv").read_text()


@pytest.mark.parametrize(
    "words", [["view", "."], ["plan", "scene.toml", "--out", "."], ["plan", "scene.toml", "--out", "/"]]
)
def test_a_folder_without_a_name_has_a_picture(
    words: list[str], run: Path, small_run: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    Scene.parse(dict(small_run.scene)).save(run / "scene.toml")
    monkeypatch.chdir(run)
    picture = ["--picture", "here.png"] if words[-1] == "/" else []
    assert main([*words, *picture]) == 0
    capsys.readouterr()


def test_a_list_of_files_leads_nowhere_else(tmp_path: Path) -> None:
    names = ["figures/lines-/../../../a", "/etc/passwd", "../a", "figures/lines-a.png"]
    (tmp_path / own_files.SUMS).write_text("\n".join([own_files.MARK, *(f"{'0' * 64}  {name}" for name in names)]))
    assert list(own_files.listed(tmp_path)) == names[3:]


def test_tables_of_others_are_not_replaced_and_their_pictures_stay(run: Path, small_run: Any, tmp_path: Path) -> None:
    both = wf.compare([small_run, run])
    for name in ("sweep.csv", "compare.csv"):
        (tmp_path / name).write_text("mine")
    with pytest.raises(SceneError, match=r"holds sweep.csv, which no run of wakeflow wrote"):
        wf.sweep([shipped("vacuum")], tmp_path)
    with pytest.raises(SceneError, match=r"holds compare.csv, which no run of wakeflow wrote"):
        both.write(tmp_path)
    (tmp_path / "compare.csv").unlink()
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "lines-of-a-poem.png").write_text("mine")
    for _ in range(2):
        both.write(tmp_path)
    assert (tmp_path / "figures" / "lines-of-a-poem.png").read_text() == "mine"
    assert (tmp_path / "sweep.csv").read_text() == "mine"


def test_a_list_of_pictures_leads_nowhere_else(run: Path, theirs: Path) -> None:
    """It is read to know what an earlier report left, which is removed."""
    picture = {"kind": "curves", "files": ["../../mine/landing.png"], "text": "", "numbers": {}}
    write_json(run / "figures" / "pictures.json", {"tracks": picture})
    main(["report", str(run)])
    assert (theirs / "landing.png").read_text() == "a photo"


def test_what_a_killed_write_left_is_removed_by_the_next_run(run: Path, small_run: Any) -> None:
    for left in (run / ".result.json.0123abcd.tmp", run / "figures" / ".landing.png.0123abcd.tmp"):
        left.write_text("half")
    (run / ".notes.tmp").write_text("mine")
    wf.run(Scene.parse(dict(small_run.scene)), run, report=False)
    assert sorted(path.name for path in run.rglob(".*")) == [".lock", ".notes.tmp"]


@pytest.fixture
def _private() -> Iterator[None]:
    before = os.umask(0o077)
    yield
    os.umask(before)


@pytest.mark.usefixtures("_private")
def test_the_umask_is_heeded(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "a") as stream:
        stream.write("mine")
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o600


def test_no_cell_of_a_csv_file_is_a_formula(tmp_path: Path) -> None:
    texts = ["=cmd|calc!A0", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "-0.5", "+1e-3", "plain"]
    CellTable(["=head", "number"], [[text, -1.5] for text in texts]).write_csv(tmp_path / "a.csv")
    with (tmp_path / "a.csv").open() as stream:
        head, *rows = csv.reader(stream)
    assert head == ["'=head", "number"]
    assert [row[0] for row in rows] == [*(f"'{text}" for text in texts[:5]), *texts[5:]]
    assert {row[1] for row in rows} == {"-1.5"}


@pytest.mark.parametrize("name", ["...", "..", ".", " ", "....x"])
def test_a_name_of_dots_leads_into_no_other_folder(name: str) -> None:
    made = Path("runs", run_folder(Path(f"{name}.toml").stem, shipped("vacuum"), [], {}))
    assert re.fullmatch(r"runs/[^/.]+[^/]*", str(Path(os.path.normpath(made))))
