"""The page as a person uses it, in Debian's chromium: by mouse, by keyboard alone, in any width and colours."""

import itertools
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from serving import Served, served

import wakeflow as wf
from support import MIN_CONTRAST, lowest_contrast, shipped
from wakeflow.core.files import scene_templates

pytestmark = pytest.mark.browser

WIDTHS = (390, 1024, 1400)
SECONDS = 900_000  # ms: of a run on a machine with other work


@contextmanager
def _opened(page: Served, browser: Any, width: int = 1400, colours: str = "light") -> Iterator[Any]:
    """The page; whatever it says to the console or asks of anyone but its own server fails the test."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=colours)
    opened, told = context.new_page(), []
    opened.set_default_timeout(60_000)
    opened.on("console", lambda message: told.append(message.text))
    opened.on("pageerror", lambda error: told.append(str(error)))
    own = (page.address, "data:")
    opened.on("request", lambda asked: told.append(asked.url) if not asked.url.startswith(own) else None)
    opened.on("dialog", lambda dialog: dialog.accept())
    opened.goto(page.address)
    opened.wait_for_selector("#plan table", state="attached")
    yield opened
    context.close()
    assert told == []


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Served]:
    (tmp_path / "rhombus.toml").write_text(scene_templates()["rhombus"].read_text())
    with served(tmp_path / "rhombus.toml", tmp_path / "runs") as found:
        yield found


def _wait(opened: Any, ready: str, arg: Any = None, timeout: float = 60_000) -> None:
    """Until an expression is true. Playwright's own way evaluates text in the page, which the page's policy forbids."""
    end = time.monotonic() + timeout / 1000
    while not opened.evaluate(ready, arg):
        assert time.monotonic() < end, ready
        time.sleep(0.05)


def _drag(opened: Any, name: str, by: tuple[int, int]) -> None:
    """Drag a handle of the drawing by dots."""
    box = opened.locator(f"[data-handle='{name}'] circle").last.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    opened.mouse.move(x, y)
    opened.mouse.down()
    for part in range(1, 6):
        opened.mouse.move(x + by[0] * part / 5, y + by[1] * part / 5)
    opened.mouse.up()


def _value(opened: Any, key: str) -> Any:
    return opened.locator(f"[data-key='{key}']")


def _becomes(opened: Any, key: str, pattern: str) -> str:
    """The value of a field as soon as it is like that."""
    _wait(
        opened,
        "([key, pattern]) => new RegExp(pattern).test(document.querySelector(`[data-key='${key}']`).value)",
        arg=[key, pattern],
    )
    found: str = _value(opened, key).input_value()
    return found


# That both bins at a divider have the same new end, in the form and in the file. One look at all: on a busy machine
# the answer to an earlier part of the way may be on the page when the mouse is up
DRAGGED = """([key, other, pattern]) => {
  const [to, from] = [key, other].map((one) => document.querySelector(`[data-key='${one}']`).value);
  const text = document.getElementById("text").value;
  return new RegExp(pattern).test(to) && from === to && text.includes(`to = "${to}"`);
}"""


def test_a_divider_is_dragged_and_a_wrong_speed_is_told_as_it_is_typed(page: Served, browser: Any) -> None:
    """The short one, of the default suite."""
    with _opened(page, browser) as opened:
        _drag(opened, "divider bin.middle.to", (20, 0))
        _wait(opened, DRAGGED, arg=["bin.middle.to", "bin.inner-right.from", r"^(8[1-9]|9\d|1\d\d) mm$"])
        assert "# below the suction zone" in opened.locator("#text").input_value()
        speed = _value(opened, "air.speed")
        speed.fill("1,5 m/s")
        _wait(opened, "document.getElementById('mistake').textContent")
        told = opened.locator("#mistake").text_content()
        assert told == (
            "rhombus.toml: air.speed = '1,5 m/s': a decimal point is written '.', and thousands without a mark: "
            "'1.5 m/s'"
        )
        assert opened.locator("#run").is_disabled()
        opened.locator(".field.wrong .cure", has_text="Write 1.5 m/s").click()
        _becomes(opened, "air.speed", "^1.5 m/s$")
        _wait(opened, "document.getElementById('plan').textContent.includes('1.5 m/s down')")
        assert not opened.locator("#mistake").is_visible()
        opened.locator("#undo").click()
        opened.locator("#undo").click()
        assert _becomes(opened, "bin.middle.to", "^80 mm$")
        assert opened.locator("#text").input_value() == scene_templates()["rhombus"].read_text()


def test_a_field_stays_that_is_emptied_and_a_line_is_mended_with_a_click(page: Served, browser: Any) -> None:
    with _opened(page, browser) as opened:
        width = _value(opened, "feed.width")
        width.fill("")
        _wait(opened, "!/\\[feed\\][^[]*width/.test(document.getElementById('text').value)")
        assert width.is_visible()
        assert opened.evaluate("document.activeElement.dataset.key") == "feed.width"
        opened.keyboard.type("41 mm")
        _wait(opened, "document.getElementById('text').value.includes('width = \"41 mm\"')")
        text = opened.locator("#text")
        for wrong, cure in (("turbulence = 0,04", "turbulence = 0.04"), ("turbulence = 4 %", "turbulence = '4 %'")):
            text.fill(re.sub(r"turbulence = \S+", wrong, text.input_value()))
            opened.locator("#mistake .cure", has_text=f"Write {cure}").click()
            _wait(opened, "cure => document.getElementById('text').value.includes(cure)", arg=f"{cure}   ")


def test_a_page_that_is_closed_ends_the_server(page: Served, browser: Any) -> None:
    with _opened(page, browser):
        assert not page.page.session.queue.busy
    end = time.monotonic() + 60
    while not page.page.loop.is_closed() and time.monotonic() < end:
        time.sleep(0.1)
    assert page.page.loop.is_closed()


def test_any_number_of_pages_shows_the_scene(page: Served, browser: Any) -> None:
    """A browser opens six ordinary connections to a host, and all its tabs share them."""
    with _opened(page, browser) as first:
        tabs = [first.context.new_page() for _ in range(8)]
        for tab in tabs:
            tab.goto(page.address)
            tab.wait_for_selector("#plan table", state="attached")
        _value(first, "air.speed").fill("6 m/s")
        for tab in tabs:
            _becomes(tab, "air.speed", "^6 m/s$")


@pytest.mark.slow
def test_the_keyboard_alone_does_all(page: Served, browser: Any) -> None:
    with _opened(page, browser) as opened:
        handle = "[data-handle='divider bin.middle.to']"
        for _ in range(200):
            opened.keyboard.press("Tab")
            if opened.evaluate(f'document.activeElement === document.querySelector("{handle}")'):
                break
        else:
            raise AssertionError("Tab does not reach the divider")
        for _ in range(3):
            opened.keyboard.press("ArrowRight")
        _becomes(opened, "bin.middle.to", "^83 mm$")
        opened.keyboard.press("Shift+ArrowRight")
        _becomes(opened, "bin.middle.to", "^93 mm$")
        assert opened.evaluate("document.activeElement.dataset.handle") == "divider bin.middle.to"
        opened.keyboard.press("Enter")  # to its value
        assert opened.evaluate("document.activeElement.dataset.key") == "bin.middle.to"
        opened.keyboard.type("100 mm")
        opened.keyboard.press("Tab")
        _wait(opened, "document.getElementById('text').value.includes('to = \"100 mm\"')")
        opened.keyboard.press("Control+s")
        _wait(opened, "document.getElementById('told').textContent.endsWith('saved')")
        assert 'to = "100 mm"' in page.page.session.document.path.read_text()
        opened.locator("#text").focus()
        opened.keyboard.press("Control+Home")
        opened.keyboard.type("# mine\n")
        _wait(opened, "document.getElementById('scene-name').textContent.includes('not saved')")
        opened.keyboard.press("Control+s")
        _wait(opened, "!document.getElementById('scene-name').textContent.includes('not saved')")
        assert page.page.session.document.path.read_text().startswith("# mine\n")


def test_two_pages_show_one_scene_and_the_file(page: Served, browser: Any) -> None:
    with _opened(page, browser) as one, _opened(page, browser) as other:
        _value(one, "air.speed").fill("6 m/s")
        _becomes(other, "air.speed", "^6 m/s$")
        path = page.page.session.document.path
        assert path is not None
        path.write_text(path.read_text().replace("500 kg/hour", "400 kg/hour"))
        for opened in (one, other):
            _wait(opened, "!document.getElementById('conflict').hidden")
        other.locator("[data-keep='']").click()
        _becomes(one, "feed.rate", "^400 kg/hour$")
        _becomes(one, "air.speed", "^5 m/s$")


@pytest.mark.slow
@pytest.mark.openfoam
@pytest.mark.timeout(3600)
def test_runs_are_made_stopped_gone_on_with_and_compared(page: Served, browser: Any) -> None:
    with _opened(page, browser) as opened:
        opened.locator("#open").select_option("kind:vacuum")
        _becomes(opened, "feed.width", "^20 mm$")
        _value(opened, "body.prism.slope_angle").fill("50 deg")
        opened.locator("#run-name").fill("steep")
        opened.locator("#run").click()
        _wait(opened, "document.getElementById('queue').textContent.split('recovery').length == 3", timeout=SECONDS)
        opened.locator("#open").select_option("kind:prism")
        _becomes(opened, "feed.width", "^45 mm$")
        opened.locator("#show-all").check()
        for key, typed in (("numerics.mesh_scale", "3"), ("feed.count", "256"), ("numerics.tolerance", "1e-3")):
            _value(opened, key).fill(typed)
            _value(opened, key).press("Enter")
        text = opened.locator("#text")
        _wait(opened, "document.getElementById('text').value.includes('tolerance')")
        text.fill(text.input_value() + '[force]\ncollisions = "off"\nair-loading = "off"\n')
        opened.wait_for_selector("[data-key='force.air-loading']")
        opened.locator("#quick").uncheck()
        opened.locator("#run-name").fill("coarse")
        opened.locator("#run").click()
        job = opened.locator(".job", has_text="coarse")
        job.get_by_text(re.compile(r"stage \d+ of \d+")).wait_for(timeout=SECONDS)
        job.locator("button", has_text="Stop").click()
        job.locator("button", has_text="Go on").wait_for()
        assert "goes on from there" in job.text_content()
        job.locator("button", has_text="Go on").click()
        job.locator("button", has_text="Results").click(timeout=SECONDS)
        opened.wait_for_selector("#shares table")
        assert "wheat" in opened.locator("#shares").text_content()
        assert opened.frame_locator("#report").locator("h1").text_content() == "prism"  # the machine
        opened.frame_locator("#report").locator("#play").click()
        opened.wait_for_timeout(500)
        assert opened.frame_locator("#report").locator("#play").text_content() == "Pause"
        for name in ("steep", "steep-first-look"):
            opened.locator(f"#runs input[value='{name}']").check()
        opened.locator("#compare").click()
        opened.wait_for_selector("#differs table")
        assert "feed.count" in opened.locator("#differs").text_content()
        opened.frame_locator("#report").locator("#all").wait_for(state="attached")  # the frame loads


def _done(opened: Any, name: str) -> str:
    """What a job of the list says as soon as it has ended well."""
    job = opened.locator(".job", has=opened.locator("strong", has_text=re.compile(f"^{re.escape(name)}$")))
    job.locator("button", has_text="Results").wait_for(timeout=SECONDS)
    found: str = job.text_content()
    return found


COMPUTED = """([bin, fraction]) => {
  const at = [...document.querySelectorAll("#shares thead th")].findIndex((one) => one.textContent === fraction);
  const row = [...document.querySelectorAll("#shares tbody tr")].find((one) => one.firstChild.textContent === bin);
  return row.children[at].textContent.split(" ")[0];
}"""


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_search_is_filled_in_stopped_and_gone_on_with_and_trays_are_told_beside_the_answer(
    tmp_path: Path, browser: Any
) -> None:
    few = {"feed.count": 64, "feed.rate": "1 g/hour", "feed.depth": "1 m", "limit.loss.hard": "99 %"}
    (tmp_path / "sieve.toml").write_text(shipped("vacuum", few).as_toml())
    with served(tmp_path / "sieve.toml", tmp_path / "runs") as page, _opened(page, browser) as opened:
        opened.locator("#quick").uncheck()
        opened.locator("#kind").select_option("search")
        form = {name: opened.locator(f"[data-search='{name}']").first for name in ("most", "from", "to", "time")}
        form["most"].fill("recovery.hrad")
        opened.locator("[data-search='key to change']").first.fill("fraction.hard.restitution")
        form["from"].fill("0,4")
        form["to"].fill("0.6")
        form["time"].fill("20 s")
        opened.locator("#run").click()
        _wait(opened, "document.getElementById('told').textContent.includes(\"did you mean 'recovery.hard'\")")
        assert opened.locator("#search-form input.wrong").evaluate_all("all => all.map((one) => one.value)") == [
            "recovery.hrad"
        ]
        form["most"].fill("recovery.hard")
        opened.locator("#run").click()
        opened.locator(".job button", has_text="Stop").click()
        opened.locator(".job button", has_text="Go on").click()
        assert "recommended: hard restitution 0." in _done(opened, "sieve-search")
        opened.locator(".job button", has_text="Results").click()
        opened.wait_for_selector(".point")
        opened.locator("#show-machine").click()
        opened.locator("#capacity").click()  # one click
        assert "loss.hard at most 99 %: met" in _done(opened, "sieve-capacity")
        opened.locator("#kind").select_option("run")
        opened.locator("#run").click()
        _done(opened, "sieve")
        opened.locator(".job", has_text="recovery").last.locator("button", has_text="Results").click()
        opened.wait_for_selector("#measured table", state="attached")
        assert opened.frame_locator("#report").locator("h1").text_content() == "prism"  # the machine
        opened.locator("#measured summary").click()
        tray = opened.locator("#measured input[data-bin=far][data-fraction=hard]")
        tray.fill("6O")
        opened.locator("#measured button").click()
        assert tray.get_attribute("class") == "wrong"
        tray.fill(opened.evaluate(COMPUTED, ["far", "hard"]).replace(".", ","))
        opened.locator("#measured button").click()
        assert "The measurement " in _done(opened, "sieve and what was measured")
        opened.locator(".job", has_text="measured").locator("button", has_text="Results").click()
        _wait(opened, "document.getElementById('shares').textContent.includes('the answer of the calibrated machine')")
        _wait(opened, "document.getElementById('beside').textContent.includes('the answer before its calibration')")
        assert "Calibrated with" in opened.locator("#answer-name").text_content()
        assert opened.locator("#runs button[title='sieve']").count() == 1  # the run's own answer is still there


@pytest.fixture(scope="module")
def runs(small_run: wf.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run, with a sweep beside it."""
    runs = tmp_path_factory.mktemp("runs")
    shutil.copytree(small_run.folder, runs / "vacuum")
    scenes = wf.variants(wf.Scene.parse(small_run.scene), {"fraction.hard.restitution": [0.4, 0.6]})
    wf.sweep(scenes, runs / "rebound", workers=1, figures=False)
    return runs


@pytest.fixture
def finished(runs: Path) -> Iterator[Served]:
    """A page opened for a finished run."""
    with served(runs / "vacuum", runs) as found:
        yield found


@pytest.mark.slow
def test_dividers_of_a_finished_run_take_the_shares_along(finished: Served, browser: Any) -> None:
    with _opened(finished, browser) as opened:
        opened.wait_for_selector("#shares table")
        before = opened.locator("#shares").text_content()
        assert "the run's own answer" in before
        assert opened.locator("#own-dividers").is_disabled()
        assert opened.locator("#dividers svg polygon").count() > 2
        opened.locator("[data-layer=tracks]").check()
        opened.wait_for_selector("#tracks path", state="attached")
        opened.locator("[data-layer=tracks]").uncheck()
        assert opened.locator("#tracks path").count() == 0
        assert opened.locator("#air path").count() == 0  # a vacuum
        box = opened.locator(".divider .reach").nth(1).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        opened.mouse.move(x, y)
        opened.mouse.down()
        for part in range(1, 21):
            opened.mouse.move(x - 3 * part, y)
        _wait(opened, "document.getElementById('shares').textContent.includes('as they are here')")  # still held
        opened.mouse.up()
        opened.locator("#use-dividers").click()
        moved = _becomes(opened, "bin.near.to", r"^\d+ mm$")
        assert moved != "120 mm"
        opened.locator("#show-results").click()
        opened.locator("#own-dividers").click()
        _wait(opened, "document.getElementById('shares').textContent.includes(\"the run's own answer\")")
        assert opened.locator("#shares").text_content() == before


@pytest.mark.slow
def test_a_point_of_a_sweep_opens_its_run(finished: Served, browser: Any) -> None:
    with _opened(finished, browser) as opened:
        opened.locator("#show-results").click()
        opened.locator("#sweeps button").click()
        opened.wait_for_selector(".point")
        assert opened.locator(".point").count() == 2
        opened.locator("#of").select_option("recovery.hard")
        name = opened.locator(".point").first.get_attribute("data-scene")
        opened.locator(".point").first.focus()
        opened.keyboard.press("Enter")
        opened.wait_for_selector("#shares table")
        assert opened.locator("#answer-name").text_content() == f"rebound/{name}"


@pytest.mark.slow
@pytest.mark.parametrize(("width", "colours"), [*itertools.product(WIDTHS, ("light", "dark"))])
def test_any_width_and_colours_can_be_read(width: int, colours: str, finished: Served, browser: Any) -> None:
    with _opened(finished, browser, width, colours) as opened:
        opened.wait_for_selector("#shares table")
        for which in ("results", "machine"):
            opened.locator(f"#show-{which}").click()
            assert lowest_contrast(opened) >= MIN_CONTRAST, which
            wide = opened.evaluate("document.documentElement.scrollWidth")
            assert wide <= width, f"{which} is {wide} wide"
            small = opened.evaluate(
                "Math.min(...[...document.querySelectorAll('button, select, input:not([type=checkbox])')]"
                ".filter((node) => node.offsetParent).map((node) => node.getBoundingClientRect().height))"
            )
            assert small >= 20  # dots: can be hit
