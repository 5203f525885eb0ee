"""Who may ask the page for what: its own script with its token, and nobody else; what two pages see of one."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from serving import Served, served
from tornado.httpclient import HTTPClientError

import wakeflow as wf
from wakeflow.cli import main
from wakeflow.core import own_files
from wakeflow.core.errors import SceneError
from wakeflow.core.files import scene_templates
from wakeflow.extras.page.session import Session
from wakeflow.extras.page.stored import listing
from wakeflow.extras.page.tasks import filled_in

JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory, small_run: wf.Result) -> Iterator[Served]:
    home = tmp_path_factory.mktemp("home")
    (home / "rhombus.toml").write_text(scene_templates()["rhombus"].read_text())
    with served(home / "rhombus.toml", small_run.folder.parent) as found:
        yield found


def test_only_the_token_opens_the_page(page: Served) -> None:
    token = page.page.token
    assert len(token) >= 32
    for path in ("/", "/page.html", f"/{token[:-1]}/", f"/x{token}/", "//", f"/{token.swapcase()}/state"):
        assert page.request(path)[0] == 403, path
        assert page.request(path, "POST", "{}", JSON)[0] == 403, path
    status, text, headers = page.request(f"/{token}/")
    assert status == 200
    assert "<title>wakeflow</title>" in text
    assert headers["Referrer-Policy"] == "no-referrer"  # the token stays here
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]


def test_the_address_that_a_browser_is_started_with_leads_to_the_page_once(page: Served) -> None:
    path, token = page.page.first_address.partition(str(page.page.port))[2], page.page.token
    assert token not in path
    assert page.request(f"{path}x")[0] == page.request(path, headers={"Host": "evil.example"})[0] == 403
    status, _, headers = page.request(path)
    assert (status, headers["Location"]) == (302, f"/{token}/")
    assert page.request(path)[0] == page.request("/once/")[0] == 403


def test_another_site_gets_nothing(page: Served) -> None:
    path, own = f"/{page.page.token}/edit", f"127.0.0.1:{page.page.port}"
    body = json.dumps({"set": {"air.speed": "99 m/s"}})
    before = page.page.session.document.text
    for headers in (
        JSON | {"Origin": "http://evil.example"},
        JSON | {"Origin": "null"},  # a sandboxed frame, such as a report's
        JSON | {"Origin": f"http://{own}", "Host": f"evil.example:{page.page.port}"},  # a rebound name server
        JSON | {"Origin": f"http://{own}", "Sec-Fetch-Site": "cross-site"},
        {"Content-Type": "text/plain", "Origin": f"http://{own}"},  # what a form can send
        {"Content-Type": "application/x-www-form-urlencoded"},
    ):
        assert page.request(path, "POST", body, headers)[0] == 403, headers
    for name in ("evil.example", f"evil.example:{page.page.port}", "127.0.0.1:1"):
        assert page.request(f"/{page.page.token}/", headers={"Host": name})[0] == 403
    assert page.request(f"/{page.page.token}/", headers={"Sec-Fetch-Site": "cross-site"})[0] == 403
    assert page.request(path, "PUT", body, JSON)[0] in (403, 405)
    assert page.page.session.document.text == before
    assert page.page._server is not None
    assert all(one.getsockname()[0] == "127.0.0.1" for one in page.page._server._sockets.values())


@pytest.mark.parametrize(
    "path",
    ["../server.py", "run/../../../../etc/passwd", "run/%2e%2e/%2e%2e/secret", "run/%2fetc", "run/..%2f..%2fsecret",
     "run/vacuum/../../secret", "run/vacuum%00", "compared/../..", "compared/%2e%2e/x", "page.html", "server.py",
     "run/."],
)  # fmt: skip
def test_no_path_leads_out_of_the_folder(path: str, page: Served) -> None:
    secret = page.page.session.runs.parent / "secret"
    secret.mkdir(exist_ok=True)
    (secret / "report.html").write_text("secret")
    (secret / "compare.html").write_text("secret")
    (secret / "result.json").write_text("{}")
    status, text, _ = page.request(f"/{page.page.token}/{path}")
    assert status in (403, 404), text
    assert "secret" not in text


def test_no_link_leads_out_of_the_folder(page: Served, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / "report.html").write_text("secret")
    link = page.page.session.runs / "link"
    link.symlink_to(tmp_path)
    try:
        assert page.request(f"/{page.page.token}/run/link/")[0] == 404
        assert "no 'link'" in page.ask("landings", run="link")["refused"]
    finally:
        link.unlink()


def test_names_do_not_lead_out_of_the_folder(page: Served, tmp_path: Path) -> None:
    for name in ("../elsewhere", "/etc/x", ".hidden", "a/b", "x\0", ".."):
        assert "a name without a folder" in page.ask("save", name=name)["refused"], name
        assert "name a run without slashes" in page.ask("run", name=name)["refused"], name
        assert "no " in page.ask("open", file=name, drop=True)["refused"], name
        assert "no " in page.ask("landings", run=name)["refused"], name
        assert "no " in page.ask("sweep", sweep=f"{name}/..")["refused"], name
    assert not [*tmp_path.iterdir()]


def test_a_report_has_no_right_to_the_page_around_it(page: Served) -> None:
    status, text, headers = page.request(f"/{page.page.token}/run/vacuum/")
    assert status == 200
    assert "<h1>prism" in text
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts; default-src 'none'")
    assert "allow-same-origin" not in headers["Content-Security-Policy"]


def test_a_request_that_is_no_action_is_refused(page: Served) -> None:
    own = JSON | {"Origin": f"http://127.0.0.1:{page.page.port}"}
    token = page.page.token
    assert page.request(f"/{token}/close", "POST", "{}", own)[0] == 404  # a method of the session, but no action
    assert page.request(f"/{token}/__init__", "POST", "{}", own)[0] == 404
    assert page.request(f"/{token}/state", "POST", "[]", own)[0] == 400
    assert page.request(f"/{token}/state", "POST", "{", own)[0] == 400
    assert page.request(f"/{token}/state", "POST", "[" * 100_000, own)[0] == 400
    for name in ("", "\udcff", "a\nb"):
        assert (
            "a name without a folder"
            in json.loads(page.request(f"/{token}/save", "POST", json.dumps({"name": name}), own)[1])["refused"]
        )
    assert "at most 1000000" in page.ask("edit", text="x" * 1_000_001)["refused"]


def test_a_mistake_is_in_the_words_of_the_command_line(page: Served, capsys: pytest.CaptureFixture[str]) -> None:
    page.ask("state")
    found = page.ask("edit", set={"air.speed": "1,5 m/s"})
    assert main(["plan", str(scene_templates()["rhombus"]), "--set", "air.speed=1,5 m/s"]) == 2
    assert found["mistake"] == capsys.readouterr().err.strip().removeprefix("wakeflow: ")
    assert found["svg"]  # the machine as it was when it last was right
    assert page.ask("plan")["lines"] is None
    assert found["mistake"] in page.ask("run")["refused"]
    assert page.ask("edit", undo=True)["mistake"] == ""


def test_the_plan_says_its_lines_and_what_the_air_lifts(page: Served, capsys: pytest.CaptureFixture[str]) -> None:
    page.ask("open", kind="prism", drop=True)
    plan = page.ask("plan")
    assert [label for label, _ in plan["lines"] if label][:4] == ["machine", "air", "lifting", "feed"]
    assert {one["name"]: one["told"] for one in plan["falls"]} == {
        "dust": "is lifted", "chaff": "is lifted", "wheat": "falls"
    }  # fmt: skip
    page.ask("open", file="rhombus.toml", drop=True)


def test_two_pages_on_one_scene_see_each_other(page: Served) -> None:
    first = page.ask("state")
    page.ask("edit", set={"air.speed": "6 m/s"})  # by the one
    key = page.ask("edit", set={"feed.width": "41 mm"})  # by the other: another key, both count
    assert 'speed = "6 m/s"' in key["text"]
    assert 'width = "41 mm"' in key["text"]
    written = first["text"].replace("# u'/U at the inlet", "# measured")  # a text that does not know of these keys
    late = page.ask("edit", text=written, before=first["text"])
    assert all(one in late["text"] for one in ('speed = "6 m/s"', 'width = "41 mm"', "# measured"))
    clash = page.ask("edit", text=first["text"].replace("5 m/s", "7 m/s"), before=first["text"])
    assert "another page has changed the same lines" in clash["refused"]
    assert page.ask("state")["text"] == late["text"]
    page.ask("edit", undo=True)
    assert page.ask("state")["text"] == key["text"]
    page.ask("edit", undo=True)
    page.ask("edit", undo=True)


def test_a_scene_that_changes_on_the_disk_is_shown(page: Served) -> None:
    path = page.page.session.document.path
    assert path is not None
    text = path.read_text()
    path.write_text(text.replace("5 m/s", "4 m/s"))
    page.page.session.watch()
    assert 'speed = "4 m/s"' in page.ask("state")["text"]
    page.ask("edit", set={"air.speed": "3 m/s"})
    path.write_text(text)
    page.page.session.watch()
    assert page.ask("state")["conflict"] is True
    assert "choose which of the two" in page.ask("save")["refused"]
    assert 'speed = "3 m/s"' in page.ask("settle", keep=True)["text"]
    page.ask("save")
    assert 'speed = "3 m/s"' in path.read_text()
    assert page.ask("edit", text=text)["changed"] is True
    assert page.ask("save")["changed"] is False


def test_events_tell_every_open_page(page: Served) -> None:
    with ExitStack() as stack:
        pages = [stack.enter_context(page.listening()) for _ in range(12)]
        page.ask("edit", set={"air.speed": "5.5 m/s"})
        for heard in pages:
            told = next(one for one in iter(heard, None) if one["kind"] == "scene")
            assert "5.5 m/s" in told["data"]["text"]
    page.ask("edit", undo=True)


def test_only_the_page_itself_hears_the_events(page: Served) -> None:
    own = f"http://127.0.0.1:{page.page.port}"
    foreign = ({"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": own, "Host": "evil.example"},
               {"Origin": own, "Sec-Fetch-Site": "same-site"})  # fmt: skip
    asked: list[dict[str, Any]] = [{"token": page.page.token[:-1]}, *({"headers": one} for one in foreign)]
    for how in asked:
        with pytest.raises(HTTPClientError, match="403"), page.listening(**how):
            pass


def test_a_missing_scene_is_one_line_and_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["open", str(tmp_path / "nowhere.toml"), "--no-browser"]) == 2
    assert "make a scene with: wakeflow new" in capsys.readouterr().err


def test_measured_trays_wait_in_the_list_with_the_runs_own_options(
    page: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, added = page.page.session, list[dict[str, object]]()
    monkeypatch.setattr(session.queue, "add", lambda **asked: added.append(asked))
    assert "at least one" in page.ask("measured", run="vacuum", rows=[], error="2")["wrong"]["trays"]
    for typed in ("2 6", "26;5", "1,000.5", "-3", "101", "26.5 kg", "nan", "\u0665"):
        found = page.ask("measured", run="vacuum", rows=[["hard", "far", typed]], error="0")["wrong"]
        assert repr(typed) in found["hard in far"], typed
    assert "above 0" in page.ask("measured", run="vacuum", rows=[["hard", "far", "26,5"]], error="0,0")["wrong"]["±"]
    assert not added
    page.ask("measured", run="vacuum", rows=[["hard", "far", "60"], ["soft", "near", " 90,5 %"]], error="2,5")
    assert added[0]["measured"] == {
        "fraction": ["hard", "soft"], "bin": ["far", "near"], "share": [0.6, 0.905], "uncertainty": [0.025, 0.025]
    }  # fmt: skip
    assert added[0]["options"] == {"rung": None, "force": {}}
    assert added[0]["folder"] == session.runs.resolve() / "vacuum-calibrated"  # beside the run's own answer


def _search(
    most: str = "recovery.wheat", speed: str = "air.speed", low: str = "3,5 m/s", limit: str = "98,5 %",
    budget: str = "2 hour",
) -> str:  # fmt: skip
    """What the page's form of a search sends."""
    within, where = {speed: {"from": low, "to": f"7 {low.split()[1]}"}}, {"purity.outer-left.wheat": {"least": limit}}
    return json.dumps({"maximise": [most], "minimise": [], "within": within, "where": where, "budget": budget})


def test_a_search_that_can_only_be_void_does_not_wait(page: Served) -> None:
    assert "refused" not in page.ask("edit", set={"force.collisions": '"off"', "feed.rate": '"2000 kg/hour"'})
    assert "would be void" in page.ask("run", kind="search", typed=_search())["refused"]


def test_the_form_of_a_search_is_read_as_a_search_file(cases: Path) -> None:
    task = filled_in(wf.Scene.load(cases / "rhombus.toml"), _search())
    assert (task.within[0].ends, task.within[0].unit, task.budget) == ((3.5, 7.0), "m/s", 7200.0)
    assert [(one.quantity, one.least) for one in task.limits] == [("purity.outer-left.wheat", 0.985)]
    assert task.levels[0]["feed.count"] < task.scene.feed.count
    assert task.levels[1] == {}


def test_other_tasks_are_read_before_they_wait(page: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    session, added = page.page.session, list[dict[str, object]]()
    monkeypatch.setattr(session.queue, "add", lambda **asked: added.append(asked))
    for kind, typed, told in (
        ("sweeep", "", "did you mean 'sweep'"), ("sweep", "", "needs a key to change"),
        ("sweep", "air.sped=4,5", "air.sped"), ("map", "feed.width=1,2", "write air.speed or feed.rate"),
        ("search", "nowhere.toml", "no 'nowhere"), ("search", "../x.toml", "no "), ("protocol", "gravel", "gravel"),
        ("search", _search(most="recovery.wheet"), "did you mean 'recovery.wheat'"),
        ("search", _search(low="3 kg"), "search.within.air.speed = '3.0 kg'"),
        ("search", _search(limit="9 8 %"), "purity.outer-left.wheat: '9 8 %' is no percent"),
        ("search", _search(budget=""), "search.budget"), ("search", "{}", "run: maximise: "),
        ("search", _search(speed="bin.middle.too"), "bin.middle.too"),
    ):  # fmt: skip
        assert told in page.ask("run", kind=kind, typed=typed)["refused"], kind
    page.ask("open", kind="vacuum", drop=True)
    assert "no feed.rate" in page.ask("run", kind="capacity")["refused"]
    page.ask("open", file="rhombus.toml", drop=True)
    assert not added
    page.ask("run", kind="sweep", typed="air.speed=4,5 m/s; feed.width=40 mm,50 mm", quick=True)
    assert [one["folder"] for one in added] == [
        session.runs / f"rhombus-sweep{end}" for end in ("-first-look", "")
    ]  # fmt: skip
    assert page.request(f"/{page.page.token}/figure/vacuum/result.json")[0] == 404


@pytest.mark.parametrize(
    ("action", "what", "told"),
    [
        ("state", {"of": 1}, "state: of: "),
        ("edit", {"set": ["air.speed"]}, "edit: set: "),
        ("edit", {"set": {"air.speed": 3}}, "edit: set.air.speed: "),
        ("edit", {"drag": "feed", "x": float("nan"), "y": 0.0}, "edit: x: "),
        ("edit", {"text": None, "txet": ""}, "edit: txet: "),
        ("settle", {}, "settle: keep: "),
        ("open", {"kind": 3}, "open: kind: "),
        ("job", {"act": "stop", "number": "one"}, "job: number: "),
        ("job", {"act": "stop", "number": 1e300}, "job: number: "),
        ("landings", {}, "landings: run: "),
        ("dividers", {"run": "vacuum", "ends": {"far": [0.0]}}, "dividers: ends.far.1: "),
        ("compare", {"runs": "vacuum"}, "compare: runs: "),
        ("measured", {"run": "vacuum", "rows": [["hard", "far", None]], "error": "2"}, "measured: rows.0.2: "),
    ],
)
def test_a_question_of_another_shape_is_refused_in_a_line(
    page: Served, capfd: pytest.CaptureFixture[str], action: str, what: dict[str, Any], told: str
) -> None:
    assert page.ask(action, **what)["refused"].startswith(told)
    assert capfd.readouterr() == ("", "")


def test_a_run_takes_a_free_name_or_that_of_its_own_answer(page: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    session, added = page.page.session, list[dict[str, object]]()
    monkeypatch.setattr(session.queue, "add", lambda **asked: added.append(asked))
    page.ask("run", name="vacuum", quick=True)  # another scene's answer is there
    assert [asked["folder"] for asked in added] == [session.runs / "vacuum-2-first-look", session.runs / "vacuum-2"]
    page.ask("open", run="vacuum", drop=True)
    page.ask("run", name="vacuum")
    assert added[-1]["folder"] == session.runs / "vacuum"
    page.ask("open", file="rhombus.toml", drop=True)


def test_a_scene_that_is_not_there_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(SceneError, match="no scene file, run or folder"):
        Session(tmp_path / "nosuch.toml", lambda *_: None)
    assert not list(tmp_path.iterdir())


def test_runs_have_a_name_a_date_what_differs_and_the_run_before(
    small_run: wf.Result, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    scene = wf.Scene.parse(small_run.scene)
    found = wf.run(scene.replace({"fraction.hard.restitution": 0.4, "limit.loss.hard": "99 %"}), tmp_path / "own")
    shutil.copytree(small_run.folder, tmp_path / "deep" / "vacuum+feed.width=0.02")
    os.utime(tmp_path / "deep" / "vacuum+feed.width=0.02" / "result.json", (1e9, 1e9))
    scenes = wf.variants(scene, {"fraction.hard.restitution": [0.4, 0.6]})
    wf.sweep(scenes, tmp_path / "sw", workers=1, figures=False)
    (tmp_path / "sw" / "airflows" / "1b4a36df8184").mkdir(parents=True)
    (tmp_path / "sw" / "airflows" / "1b4a36df8184" / "result.json").write_text("{}")
    rows = listing(tmp_path, tmp_path)["runs"]
    assert [row["title"] for row in rows] == ["own", "deep/vacuum: feed width 20 mm"]
    assert [one["name"] for one in listing(tmp_path, tmp_path)["sweeps"]] == ["sw"]
    assert str(rows[0]["differs"]) == "hard restitution 0.5 → 0.4, limit loss hard – → 0.99"
    assert rows[1]["made"] == 1e9
    home = shutil.copy(scene_templates()["rhombus"], tmp_path_factory.mktemp("home") / "rhombus.toml")
    with served(Path(home), tmp_path) as page:  # the module's ends while nobody listens
        told = page.ask("before", run="own")
        assert told["other"]["name"] == "deep/vacuum+feed.width=0.02"
        words = {row[0]: row[1:] for row in told["rows"]}
        apart = wf.compare([small_run, found]).frame()
        assert words["recovery of hard"][2].endswith(")")
        assert "recovery.hard" in set(apart["quantity"])
        assert page.ask("before", run="deep/vacuum+feed.width=0.02")["other"] is None
        assert page.ask("landings", run="own")["limits"][0].startswith("loss.hard at most 99 %: ")
        ends = page.ask("landings", run="own")["ends"]
        ends["far"][0] = ends["near"][1] = ends["near"][1] / 2
        assert page.ask("dividers", run="own", ends=ends)["limits"][0].startswith("loss.hard at most 99 %: ")


def test_what_is_odd_in_a_folder_hides_nothing_else(small_run: Any, tmp_path: Path) -> None:
    (tmp_path / "a.toml").mkdir()
    (tmp_path / "b.toml").write_bytes(b"\xff")
    (tmp_path / "c.toml").write_text("# mine\n")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "result.json").symlink_to("nowhere")
    (tmp_path / "scenes.csv").write_text("scene,share.hard.near\nx,9.4\n")
    own_files.note(tmp_path, [tmp_path / "scenes.csv"])
    (tmp_path / "scenes.csv").write_text("scene,share.hard.near\nx,0.4\n")
    session = Session(tmp_path, lambda *_: None)
    session.runs = session.finished.runs = tmp_path
    try:
        assert session.document.name == "c"
        assert session.list()["runs"] == []
        with pytest.raises(SceneError, match=r"scenes.csv is damaged"):
            session.finished.sweep(sweep=".")
    finally:
        session.close()


def test_a_scene_without_a_file_is_not_dropped_unasked(tmp_path: Path) -> None:
    session = Session(None, lambda *_: None, tmp_path)
    try:
        session.open(kind="prism")
        session.edit(set={"air.speed": "3 m/s"})
        with pytest.raises(SceneError, match="is not saved"):
            session.open(kind="vacuum")
        session.open(kind="vacuum", drop=True)
    finally:
        session.close()


def test_a_closed_terminal_leaves_no_folder(cases: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "wakeflow.cli", "open", str(cases / "vacuum.toml"), "--no-browser", "--port", "0"]
    child = subprocess.Popen(words, env=os.environ | {"TMPDIR": str(tmp_path)}, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert "http://" in child.stdout.readline()
    child.send_signal(signal.SIGHUP)
    child.communicate(timeout=60)
    assert not list(tmp_path.glob("wakeflow-page-*"))


def test_a_run_that_is_opened_from_within_has_its_name_and_a_dangling_link_hides_nothing(
    small_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = shutil.copytree(small_run.folder, tmp_path / "air.speed=3")
    (tmp_path / ".#v.toml").symlink_to("u@h.1")  # as Emacs has it
    (tmp_path / "away.toml").symlink_to("nowhere")
    (tmp_path / "v.toml").write_text("")
    monkeypatch.chdir(run)
    session = Session(Path(), lambda *_: None)
    try:
        assert session.document.name == session.shown == "air.speed=3"
        assert session.runs == tmp_path
        found = listing(tmp_path, tmp_path)
    finally:
        session.close()
    assert [one["name"] for one in found["scenes"]] == ["v.toml"]  # type: ignore[attr-defined]
