"""The page in Debian's chromium: every control works, nothing is asked of the network, paper holds every bin."""

import itertools
import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unicodedata import normalize

import pytest

import wakeflow as wf
from support import MIN_CONTRAST, lowest_contrast, shipped
from wakeflow.core.files import scene_templates
from wakeflow.scene import Scene
from wakeflow.show.words import headline, holds

pytestmark = [pytest.mark.slow, pytest.mark.browser]

CASES = Path(__file__).parents[3] / "cases"
WIDTHS = {"desk": 1280, "telephone": 360}
A4 = (595, 842)  # points
READABLE = 9.0  # points of type on the first sheet
MOST_SHEETS = {"quick": 8, "whole": 14}


@pytest.fixture(scope="module")
def comparison(small_run: wf.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the run beside one whose soft granules rebound, made by the command's own call."""
    folder = tmp_path_factory.mktemp("compared")
    other = wf.run(Scene.parse(small_run.scene).replace({"fraction.soft.restitution": 0.6}), folder / "bouncy")
    wf.compare([small_run, other]).write(folder / "out")
    return folder / "out" / "compare.html"


@contextmanager
def _opened(path: Path, browser: Any, colours: str) -> Iterator[Any]:
    """A page; whatever it says to the console or asks of the network fails the test."""
    context = browser.new_context(viewport={"width": WIDTHS["desk"], "height": 900}, color_scheme=colours)
    opened, told = context.new_page(), []
    opened.on("console", lambda message: told.append(message.text))
    opened.on("pageerror", lambda error: told.append(str(error)))
    opened.on("request", lambda asked: told.append(asked.url) if not asked.url.startswith(("file:", "data:")) else None)
    opened.goto(path.as_uri())
    yield opened
    context.close()
    assert told == []


@pytest.fixture(params=["light", "dark"])
def page(request: pytest.FixtureRequest, browser: Any, small_run: wf.Result) -> Iterator[Any]:
    with _opened(small_run.folder / "report.html", browser, request.param) as opened:
        yield opened


@pytest.fixture(params=["light", "dark"])
def compared(request: pytest.FixtureRequest, browser: Any, comparison: Path) -> Iterator[Any]:
    with _opened(comparison, browser, request.param) as opened:
        yield opened


@pytest.fixture(params=itertools.product(("report", "comparison"), ("light", "dark")), ids="-".join)
def either(request: pytest.FixtureRequest, browser: Any, small_run: wf.Result, comparison: Path) -> Iterator[Any]:
    which, colours = request.param
    path = small_run.folder / "report.html" if which == "report" else comparison
    with _opened(path, browser, colours) as opened:
        yield opened


def _drawn(page: Any) -> str:
    """What the canvas shows."""
    found: str = page.evaluate("document.getElementById('machine').toDataURL()")
    return found


def test_every_control_changes_what_is_shown(page: Any, small_run: wf.Result) -> None:
    for name in ("show-tracks", "show-granules", "by-mass"):
        before = _drawn(page)
        page.locator(f"#{name}").click()
        if name != "by-mass":  # the fractions of this scene may have the same mass
            assert _drawn(page) != before, name
    for name in ("zoom-in", "zoom-out", "zoom-all"):
        page.locator("#zoom-in").click()
        before = _drawn(page)
        page.locator(f"#{name}").click()
        assert _drawn(page) != before, name
    page.locator("#show-granules").check()
    before = _drawn(page)
    page.locator("#phase").fill("400")
    assert _drawn(page) != before
    page.locator("#play").click()
    page.wait_for_function("document.getElementById('phase').value != '400'")
    page.locator("#play").click()
    assert page.locator("#play").text_content() == "Play"
    fraction = page.locator("[data-show]").first
    name = fraction.get_attribute("data-show")
    before = _drawn(page)
    fraction.uncheck()
    assert _drawn(page) != before
    assert page.locator(f"#bars [data-fraction='{name}']").first.is_hidden()


def test_a_bin_tells_its_shares_to_mouse_and_keyboard(page: Any, small_run: wf.Result) -> None:
    told = page.locator("#told")
    page.locator("#bin").select_option("near")
    assert told.text_content().startswith("near: of all ")
    page.locator("#bin").select_option("choose")
    assert "Point at a bin" in told.text_content()
    scene = Scene.parse(small_run.scene)
    line, channel = scene.bin["far"].line(scene).mean(axis=0), scene.channel
    page.locator("#machine").scroll_into_view_if_needed()
    box = page.locator("#machine").bounding_box()
    canvas = page.evaluate("[...['width', 'height'].map((side) => document.getElementById('machine')[side])]")
    assert box["width"] / box["height"] == pytest.approx(canvas[0] / canvas[1], rel=0.02)  # circles are round
    across, up = channel.width, channel.top - channel.bottom
    room = 0.05 * max(across, up)
    x = box["x"] + box["width"] * (line[0] + across / 2 + room) / (across + 2 * room)
    y = box["y"] + box["height"] * (channel.top + room - line[1]) / (up + 2 * room)
    page.mouse.move(x, y)
    assert told.text_content().startswith("far: ")
    page.locator("#machine").focus()
    before = _drawn(page)
    page.keyboard.press("+")
    page.keyboard.press("ArrowLeft")
    assert _drawn(page) != before


def test_runs_are_compared_by_fraction_run_picture_and_certainty(compared: Any) -> None:
    bars = compared.locator("#bars [data-fraction='soft'][data-run='1']")
    assert bars.first.is_visible()
    compared.locator("[data-show='soft']").uncheck()
    assert bars.first.is_hidden()
    compared.locator("[data-show='soft']").check()
    compared.locator("[data-show-run='1']").uncheck()
    assert bars.first.is_hidden()
    assert compared.locator("#bars [data-run='0']").first.is_visible()
    rows = compared.locator("#all tbody tr:visible")
    every = rows.count()
    compared.locator("#only-sure").check()
    assert 0 < rows.count() < every
    compared.locator("#picture").select_option("landing")
    assert compared.locator("[data-picture]:visible").count() == 1
    first, last = compared.locator("[data-picture='landing'] figure").all()
    assert (
        first.bounding_box()["y"] != last.bounding_box()["y"] or first.bounding_box()["x"] != last.bounding_box()["x"]
    )
    compared.locator("#lay-over").check()
    assert first.locator("img").bounding_box() == last.locator("img").bounding_box()
    compared.locator("#see-through").fill("25")
    assert last.evaluate("(figure) => figure.style.opacity") == "0.25"


def test_text_stands_out_from_its_ground(either: Any) -> None:
    assert lowest_contrast(either) >= MIN_CONTRAST


@pytest.mark.parametrize("width", list(WIDTHS.values()), ids=list(WIDTHS))
def test_a_page_is_no_wider_than_the_screen(width: int, either: Any) -> None:
    either.set_viewport_size({"width": width, "height": 800})
    assert either.evaluate("document.documentElement.scrollWidth") <= width


def _printed(page: Any, result: wf.Result, path: Path) -> int:
    """How many sheets a report takes; its first holds the verdict, the shares, what the interval lacks, the machine and
    one figure, all of it large enough to be read.
    """
    from pypdf import PdfReader

    page.pdf(path=path, prefer_css_page_size=True)
    sheets = PdfReader(path).pages
    sizes: list[float] = []

    def seen(text: str, above: list[float], matrix: list[float], _font: object, size: float) -> None:
        if text.strip():
            sizes.append(size * math.hypot(*above[:2]) * math.hypot(*matrix[:2]))

    first = normalize("NFKC", sheets[0].extract_text(visitor_text=seen)).replace(" ", "").replace("\n", "")  # ligatures
    assert min(sizes) >= 0.995 * READABLE
    told = [*headline(result), holds(result), "Where each fraction lands: percent of its mass"]
    assert [line for line in told if line.replace(" ", "") not in first] == []
    assert "Everyfractionineverybin" not in first
    assert socket.gethostname() not in "".join(sheet.extract_text() for sheet in sheets)
    return len(sheets)


def test_the_first_sheet_of_paper_holds_the_answer_with_the_machine_and_can_be_read(
    page: Any, small_run: wf.Result, tmp_path: Path
) -> None:
    assert _printed(page, small_run, tmp_path / "page.pdf") <= MOST_SHEETS["quick"]


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("effort", ["quick", "whole"])
@pytest.mark.parametrize("kind", sorted(set(scene_templates()) - {"vacuum"}))
def test_every_machine_takes_few_sheets(kind: str, effort: str, browser: Any, tmp_path: Path) -> None:
    """Without the airflow of a body, which takes minutes; with that of a channel, which is known."""
    scene = shipped(kind, {"feed.count": 128, **({"funnel.computed": False} if kind == "funnel" else {})})
    result = wf.run(scene, tmp_path / kind, rung="none" if scene.body else None, quick=effort == "quick")
    with _opened(result.folder / "report.html", browser, "light") as opened:
        assert _printed(opened, result, tmp_path / "page.pdf") <= MOST_SHEETS[effort]


def test_paper_holds_every_bin_and_cuts_nothing(page: Any, small_run: wf.Result, tmp_path: Path) -> None:
    from pypdf import PdfReader

    page.pdf(path=tmp_path / "page.pdf", prefer_css_page_size=True)
    sheets = PdfReader(tmp_path / "page.pdf").pages
    text = " ".join(sheet.extract_text() for sheet in sheets)
    for place in small_run.landings.separation.bins:
        assert place in text
    assert "Zoom in" not in text
    for sheet in sheets:
        size = sheet.mediabox
        assert (float(size.width), float(size.height)) == pytest.approx(A4, abs=1.0)
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 695, "height": 1000})  # A4 less its margins, at 96 dots an inch
    wide = page.evaluate(
        "[...document.querySelectorAll('table')].filter((t) => t.offsetParent && t.scrollWidth > 697).map((t) => t.id)"
    )
    assert wide == []
