"""What one page works on: a scene, its plan, the list of runs; and every action that the browser can ask for.

An action takes and gives plain JSON and raises SceneError for what a person did wrong, and those in ``actions``
pydantic's ValidationError for JSON of another shape. None knows of HTTP.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ConfigDict, validate_call

from ...answer.result import FILE, Result
from ...core.errors import SceneError, WakeflowError
from ...core.files import scene_templates
from ...core.registry import did_you_mean
from ...core.store import cache_root
from ...runs.planned import make_plan
from ...runs.progress import on_this_machine
from ...scene import Scene
from ...scene.changes import template_of
from ...show.plan_words import cost_words, plan_lines
from ...show.sketch import sketch_svg
from ..search.task import quantities_to_seek
from .document import NO_FILE, SceneDocument, merged
from .finished import CALIBRATED, FinishedRuns, Place
from .form import addable, first_keys, form_of
from .handles import dragged, handles_of, step_of
from .queue import RUN, RunQueue
from .stored import inside, listing
from .tasks import TASKS, percent_typed, task_of

if TYPE_CHECKING:
    from ...planning.plan import Plan

Say = Callable[[str, dict[str, object]], None]  # tells every open page: kind, data
RUNS = Path("runs")
checked = validate_call(config=ConfigDict(allow_inf_nan=False))


class Session:
    """The state behind the page; ``say`` is called from any thread. Actions of one kind come one at a time."""

    def __init__(self, what: Path | None, say: Say, runs: Path = RUNS) -> None:
        self.home, self.runs = Path.cwd(), runs
        self._say = say
        self._drawing = threading.Lock()  # matplotlib's fonts are everyone's
        self.shown = ""  # the run that the page was opened for
        self.document = self._first(what)
        self.finished = done = FinishedRuns(self.runs, self._drawing)
        self.queue = RunQueue(self._queue_changed)
        self._drawn: dict[str, object] = {}
        self._planned: dict[str, object] = {}
        self._held: Scene | None = None  # what is dragged is dragged from there
        self.actions = {action.__name__: checked(action) for action in (
            self.state, self.edit, self.save, self.settle, self.open, self.plan, self.run, self.job, self.list,
            self.measured, done.landings, done.inside, done.dividers, done.before, done.compare, done.sweep,
        )}  # fmt: skip

    def close(self) -> None:
        """End what is computed."""
        self.queue.close()
        self.finished.close()

    def _first(self, what: Path | None) -> SceneDocument:
        """The scene that is opened: a file, that of a run, the only one of a folder, or one to start from."""
        if what is None:
            return _template("rhombus")
        if what.name in ("", ".."):
            what = what.resolve()  # it needs a name
        if (what / FILE).is_file():
            self.runs, self.shown = what.parent, what.name
            return self._of_run(what)
        if what.is_dir():
            self.home, self.runs = what, what if any(what.glob(f"*/{FILE}")) else what / "runs"
            for path in sorted(what.glob("*.toml")):
                with suppress(SceneError):  # a folder, say
                    return SceneDocument.load(path)
            return _template("rhombus")
        if not what.exists():
            raise SceneError(
                f"no scene file, run or folder {str(what)!r}; make a scene with: wakeflow new rhombus {what}"
            )
        self.home = what.parent
        return SceneDocument.load(what)

    def _of_run(self, folder: Path) -> SceneDocument:
        result = Result.load(folder)
        return SceneDocument(Scene.parse(result.scene).as_toml(), name=folder.name)

    # -- the scene -----------------------------------------------------------------------------------------------------
    def state(self) -> dict[str, object]:
        """All of the scene as the page shows it."""
        document, look = self.document, self.document.look
        undo, redo = document.steps
        if look.scene is not None:
            self._drawn = self._draw(look.scene, look.units)
        return {
            "version": document.version, "text": document.text, "name": document.name,
            "file": None if document.path == NO_FILE else str(document.path), "changed": document.changed,
            "conflict": document.conflict, "mistake": look.mistake, "undo": undo, "redo": redo,
            **self._form(), **self._drawn,
        }  # fmt: skip

    def _form(self) -> dict[str, object]:
        """The fields as they are written; None where the text is no TOML."""
        import tomlkit

        if not self.document.look.toml:
            return {"form": None, "addable": []}
        data = tomlkit.parse(self.document.text)
        return {"form": form_of(data), "addable": addable(data)}

    def _draw(self, scene: Scene, units: Mapping[str, str]) -> dict[str, object]:
        with self._drawing:
            drawn = vars(sketch_svg(scene, units))
        return {
            **drawn, "step": step_of(scene),
            "handles": [handle.table() for handle in handles_of(scene).values()],
            "bodies": {name: body.outline().tolist() for name, body in scene.body.items()},
        }  # fmt: skip

    def edit(
        self, *, text: str | None = None, before: str | None = None, set: Mapping[str, str | None] = {},
        drag: str = "", x: Place = 0.0, y: Place = 0.0, add: str = "", undo: bool = False,
        redo: bool = False, gesture: str = "",
    ) -> dict[str, object]:  # fmt: skip
        """Change the scene: the whole ``text``, where it was ``before``; keys to ``set`` (None takes one out); a handle
        to ``drag`` to a place ``x``, ``y`` (m); a table to ``add``; or ``undo`` and ``redo``.
        """
        document = self.document
        if text is not None:
            both = merged(document.text if before is None else before, text, document.text)
            if both is None:
                raise SceneError("another page has changed the same lines: its text is shown now; change it again")
            document.write(both, gesture)
        elif set:
            document.set(set, gesture)
        elif drag:
            self._drag(drag, x, y, gesture)
        elif add:
            self._add(add)
        elif undo:
            document.undo()
        elif redo:
            document.redo()
        return self._tell_scene()

    def _drag(self, name: str, x: float, y: float, gesture: str) -> None:
        """Move a handle of the machine as it was when the gesture began: dividers that meet on the way stay two."""
        document, look = self.document, self.document.look
        if not look.toml:
            raise SceneError(look.mistake, look.mistake.splitlines())
        if look.scene is not None and (not gesture or document.gesture != gesture or self._held is None):
            self._held = look.scene
        if self._held is None:
            raise SceneError(look.mistake)
        handle = handles_of(self._held).get(name)
        if handle is None:
            raise SceneError(f"nothing called {name!r} in this machine")
        document.set(dragged(handle, self._held, look.data, x, y), gesture)

    def _add(self, table: str) -> None:
        scene = self.document.look.scene
        keys = first_keys(table, 0.4 if scene is None else scene.channel.width)
        if not keys:
            raise SceneError(f"{table}: write [{table}] and its keys into the text")
        self.document.set({f"{table}.{key}": typed for key, typed in keys.items()})

    def _tell_scene(self) -> dict[str, object]:
        state = self.state()
        self._say("scene", state)
        return state

    def save(self, *, name: str | None = None) -> dict[str, object]:
        """Write the scene to its file, or to a new one called ``name`` in the folder of the first."""
        self.document.save(NO_FILE if name is None else _new_file(self.home, name))
        return self._tell_scene()

    def settle(self, *, keep: bool) -> dict[str, object]:
        """End a conflict with the disk: ``keep`` the text here or take the file's."""
        self.document.settle(keep=keep)
        return self._tell_scene()

    def watch(self) -> None:
        """Look whether another program has changed the file."""
        if self.document.compare_with_disk():
            self._tell_scene()

    def open(self, *, file: str = "", run: str = "", kind: str = "rhombus", drop: bool = False) -> dict[str, object]:
        """Take up another scene: the ``file`` of the folder, a shipped ``kind`` to start from, or that of a ``run``.
        Raises SceneError where the one that is open is not saved, unless ``drop`` says that it may go.
        """
        if self.document.changed and any(self.document.steps) and not drop:
            raise SceneError(f"{self.document.name} is not saved: save it, or open the other one again to drop it")
        if file:
            document = SceneDocument.load(inside(self.home, file))
        elif run:
            document = self._of_run(self.finished.folder(run))
        else:
            document = _template(kind)
        document.version = self.document.version + 1
        self.document, self._drawn, self._held = document, {}, None
        return self._tell_scene()

    # -- the plan ------------------------------------------------------------------------------------------------------
    def plan(self) -> dict[str, object]:
        """The plan's lines, and of each fraction whether the air lifts it; of a wrong scene nothing. Every open page
        asks for it: it is made once a version.
        """
        if self._planned.get("version") != self.document.version:
            self._planned = self._plan()
        return self._planned

    def _plan(self) -> dict[str, object]:
        version = self.document.version  # before its text, which another thread may change meanwhile
        look = self.document.look
        if look.scene is None:
            return {"version": version, "lines": None}
        try:
            made = make_plan(look.scene)
            cost = cost_words(made, *on_this_machine(made, cache_root()))
            lines = plan_lines(made, look.scene, cost, look.units)
        except WakeflowError as problem:
            return {"version": version, "lines": None, "mistake": str(problem)}
        return {
            "version": version, "lines": lines, "notes": _notes(made), "falls": _falls(made, look.scene),
            "air": look.scene.air and look.scene.air.speed, "quantities": quantities_to_seek(look.scene),
        }  # fmt: skip

    # -- runs ----------------------------------------------------------------------------------------------------------
    def run(
        self, *, name: str = "", quick: bool = False, full: bool = True, kind: str = RUN, typed: str = ""
    ) -> dict[str, object]:
        """Put the scene as it is now at the end of the list of runs, with a first look before it where ``quick`` asks
        for it; or another ``kind`` of task with what is ``typed`` for it. Raises SceneError where it is wrong.
        """
        document, look = self.document, self.document.look
        if look.scene is None:
            raise SceneError(look.mistake)
        if kind != RUN:
            task_of(kind, look.scene, typed, self.home)
        free = self._free(name or (document.name if kind == RUN else f"{document.name}-{kind}"), look.scene, kind)
        common: dict[str, Any] = {
            "text": document.text, "base": document.base, "scene": document.name, "kind": kind, "typed": typed,
            "files": self.home,
        }  # fmt: skip
        if quick and kind != "search":  # whose levels begin with one
            folder = self.runs / f"{free}-first-look"
            self.queue.add(name=f"{free} first look", folder=folder, options={"quick": True}, **common)
        if full:
            self.queue.add(name=free, folder=self.runs / free, **common)
        return self.list()

    def _free(self, name: str, scene: Scene, kind: str = RUN) -> str:
        """The name of a run's folder: one that is free, or holds the answer of this very scene."""
        if not name or name.startswith(".") or any(letter in name for letter in "/\\\0"):
            raise SceneError(f"{name!r}: name a run without slashes, not beginning with a dot")
        for number in range(1, 1000):
            free = name if number == 1 else f"{name}-{number}"
            folder = self.runs / free
            waiting = [run for run in self.queue.runs if run.folder == folder and run.state not in ("done", "failed")]
            one_run = kind in (RUN, "protocol")
            there = (folder / FILE).exists() if one_run else folder.exists()
            if not waiting and (not there or (one_run and _same(folder, scene))):
                return free
        raise SceneError(f"a thousand runs are called {name}: choose another name")

    def job(self, *, act: str, number: int) -> dict[str, object]:
        """``stop`` a run, ``go_on`` with it, or ``drop`` it from the list, by its ``number``."""
        acts = {"stop": self.queue.stop, "go_on": self.queue.go_on, "drop": self.queue.drop}
        if act not in acts:
            raise SceneError(f"unknown act {act!r}{did_you_mean(act, list(acts))}")
        acts[act](number)
        return self.list()

    def list(self) -> dict[str, object]:
        """The runs that were asked for, and what is on the disk."""
        return {
            "queue": [run.table() for run in self.queue.runs], "kinds": list(scene_templates()),
            "shown": self.shown, "tasks": list(TASKS), **listing(self.runs, self.home),
        }  # fmt: skip

    def _queue_changed(self) -> None:
        self._say("queue", {"queue": [run.table() for run in self.queue.runs]})

    # -- measured trays -----------------------------------------------------------------------------------------------
    def measured(self, *, run: str, rows: tuple[tuple[str, str, str], ...], error: str) -> dict[str, object]:
        """Put the calibration of a ``run`` by measured trays at the end of the list, beside the run: ``rows`` of
        fraction, bin and percent as it is typed, ``error`` of each in points. What cannot be read is returned as
        ``wrong``, by its place.
        """
        folder, wrong = self.finished.folder(run), dict[str, str]()

        def part(where: str, typed: str) -> float:
            try:
                share = percent_typed(typed)
            except ValueError as problem:
                wrong[where] = str(problem)
                return 0.0
            return share

        shares = [part(f"{fraction} in {place}", typed) for fraction, place, typed in rows]
        sure = part("±", error)
        if not rows:
            wrong["trays"] = "type the percent of at least one, such as 26.5"
        if not wrong and sure == 0.0:
            wrong["±"] = "needs a number above 0: no tray is weighed exactly"
        if wrong:
            return {"wrong": wrong}
        result = Result.load(folder)
        name = folder.name.removesuffix(CALIBRATED)
        self.queue.add(
            name=f"{name} and what was measured", folder=folder.with_name(name + CALIBRATED), base=self.home,
            scene=name, text=Scene.parse(result.scene).as_toml(),
            options={"rung": result.options.rung, "force": result.options.force},
            measured={
                "fraction": [row[0] for row in rows], "bin": [row[1] for row in rows], "share": shares,
                "uncertainty": [sure] * len(rows),
            },
        )  # fmt: skip
        return self.list()


def _template(kind: str) -> SceneDocument:
    path = template_of(kind)
    return SceneDocument(path.read_text(encoding="utf-8"), name=kind, base=path.parent)


def _new_file(home: Path, name: str) -> Path:
    if not name or Path(name).name != name or name.startswith(".") or not name.isprintable() or "\\" in name:
        raise SceneError(f"{name!r}: a name without a folder, not beginning with a dot")
    return home / (name if name.endswith(".toml") else f"{name}.toml")


def _same(folder: Path, scene: Scene) -> bool:
    try:
        return bool(Result.load(folder).scene == scene.tables())
    except SceneError:
        return False


def _notes(plan: Plan) -> dict[str, list[str]]:
    """All that the plan says beyond its lines, by heading."""
    left = dict.fromkeys(f"{term.name}: {term.why}" for term in plan.left_out)
    return {"computed": list(plan.used), "left out": list(left), "notes": list(plan.warnings)}


def _falls(plan: Plan, scene: Scene) -> list[dict[str, object]]:
    """Terminal velocity (m/s) of each fraction and what the air does with it far from the bodies."""
    rows: list[dict[str, object]] = []
    for name, fraction in plan.fractions.items():
        speed = fraction.terminal_velocity
        if scene.air is None or speed is None:
            does = "falls freely"
        elif scene.air.rises:
            does = "is lifted" if speed < scene.air.speed else "falls"
        else:
            does = f"falls at {scene.air.speed + speed:.3g} m/s at most"
        rows.append({"name": name, "terminal": speed, "told": does})
    return rows
