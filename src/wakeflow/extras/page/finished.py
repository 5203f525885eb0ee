"""Finished runs as the page shows them: landings, tracks, air, dividers that move, runs side by side, sweeps.

What is asked for and what is given is plain JSON. SceneError is raised for what a person did wrong.
"""

from __future__ import annotations

import math
import shutil
import tempfile
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ...answer.budget.agreement import judged
from ...answer.result import FILE, VOID, Result, kept_granules
from ...answer.result_table import difference_of
from ...answer.shares import Separation
from ...core.errors import SceneError
from ...core.number import Number
from ...many.comparison import compare
from ...scene import Scene
from ...scene.bins import SIDES
from ...show.canvas import fraction_colours
from ...show.many_figures import main_quantities
from ...show.moving import Path2D
from ...show.sketch import sketch_svg
from ...show.views import outcome_of
from ...show.words import calibrated_with, difference_text, percent, rate_words, verdict_lines
from ..dividers.dividers import LEVEL, ON_LINE
from .handles import step_of
from .stored import differs, inside, parts_of, points_of, runs_below, scene_of

Place = Annotated[float, Field(ge=-1e6, le=1e6)]  # m
Ends = Mapping[str, tuple[Place, Place]]  # of each bin: from, to
KEPT = 8  # finished runs whose landings are kept in memory
CALIBRATED = "-calibrated"  # ends the name of the folder of a run's calibration


@dataclass(frozen=True)
class StoredLandings:
    """The landings of a run on the sides of its channel: ``side`` (n,) index into SIDES or -1, ``place`` (n,) m along
    it, ``fraction`` (n,) index, ``weight`` (n,) of each fraction's mass, which sum to 1 in each.
    """

    result: Result
    scene: Scene
    side: NDArray[np.int64]
    place: NDArray[np.float64]
    fraction: NDArray[np.int64]
    weight: NDArray[np.float64]

    @classmethod
    def of(cls, result: Result) -> StoredLandings:
        """Landings that a run keeps. Raises SceneError where it ended before its shares, or keeps none."""
        if result.landings is None:
            raise SceneError(f"{result.folder} holds no shares: the run ended before them")
        scene, data = Scene.parse(result.scene).with_top(), kept_granules(result.folder)
        x, y = np.asarray(data["position"]).T
        gaps = np.abs([(y if side in LEVEL else x) - scene.channel.sides[side] for side in SIDES])
        side = np.where(gaps.min(axis=0) <= ON_LINE, gaps.argmin(axis=0), -1)
        names = list(scene.fraction)
        fraction = np.array([names.index(name) for name in data["names"]])[data["fraction"]]
        weight = np.asarray(data["weight"], dtype=float)
        sums = np.bincount(fraction, weight, minlength=len(names))
        return cls(result, scene, side, np.where(side < 2, x, y), fraction, weight / sums[fraction])

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """The run's own dividers: from and to (m) of each bin that is open on a side."""
        return {name: bin_.ends for name, bin_ in self.scene.on_sides().items() if bin_.keeps_part is None}

    def profile(self, cells: int = 80) -> dict[str, dict[str, list[float]]]:
        """Share of a fraction's mass that lands in each of ``cells`` along a side, by side with bins and fraction."""
        sides: dict[str, dict[str, list[float]]] = {}
        for on in dict.fromkeys(bin_.on for bin_ in self.scene.on_sides().values()):
            number = SIDES.index(on)
            span = self.scene.channel.span(on)
            here = self.side == number
            sides[on] = {
                name: np.histogram(self.place[mine], cells, span, weights=self.weight[mine])[0].tolist()
                for i, name in enumerate(self.scene.fraction)
                for mine in [here & (self.fraction == i)]
            }
        return sides


class FinishedRuns:
    """The runs below the folder ``runs``; one at a time is drawn, under the lock ``drawing``."""

    def __init__(self, runs: Path, drawing: threading.Lock) -> None:
        self.runs = runs
        self._drawing = drawing  # matplotlib's fonts are everyone's
        self._compared = Path(tempfile.mkdtemp(prefix="wakeflow-page-"))

    def close(self) -> None:
        """Remove the comparisons."""
        shutil.rmtree(self._compared, ignore_errors=True)

    def folder(self, name: str) -> Path:
        """The folder of a finished run. Raises SceneError where there is none."""
        folder = inside(self.runs, name)
        if not (folder / FILE).is_file():
            raise SceneError(f"{name} holds no finished run")
        return folder

    def file(self, name: str, kind: str = "report.html") -> Path:
        """The page of a finished run, or of a comparison. Raises SceneError where there is none."""
        if kind == "compare.html":
            return inside(self._compared, f"{name}/compare.html")
        path = self.folder(name) / kind
        if not path.is_file():
            raise SceneError(f"{name} has no {kind}; draw it with: wakeflow report {self.runs / name}")
        return inside(self.runs, f"{name}/{kind}")

    def figure(self, name: str) -> Path:
        """A picture of a sweep. Raises SceneError where there is none."""
        path = inside(self.runs, name)
        if path.parent.name != "figures" or path.suffix != ".png" or not path.is_file():
            raise SceneError(f"no picture {name!r}")
        return path

    def _stored(self, name: str) -> StoredLandings:
        folder = self.folder(name)
        return _landings_in(folder, (folder / FILE).stat().st_mtime_ns)

    def landings(self, *, run: str) -> dict[str, object]:
        """What the page shows of a finished ``run``: where its granules landed, its dividers, its shares."""
        stored = self._stored(run)
        scene, channel = stored.scene, stored.scene.channel
        with self._drawing:
            drawn = vars(sketch_svg(scene))
        return {
            **drawn, "walls": channel.sides, "run": run, "folder": str(stored.result.folder),
            "calibrated": calibrated_with(stored.result),
            "report": (stored.result.folder / "report.html").is_file(),
            "protocol": (stored.result.folder / "protocol.html").is_file(),
            "colours": fraction_colours(list(scene.fraction)),
            "targets": {name: list(fraction.targets) for name, fraction in scene.fraction.items()},
            "sides": {
                on: {"span": list(channel.span(on)), "profile": profile}
                for on, profile in stored.profile().items()
            },
            "on": {name: bin_.on for name, bin_ in scene.on_sides().items()},
            "ends": stored.ends, "step": step_of(scene), **self._answer(stored, stored.ends),
        }  # fmt: skip

    def inside(self, *, run: str) -> dict[str, object]:
        """Tracks and air of a finished ``run``, to be drawn within its machine."""
        return within(self._stored(run).result)

    def dividers(self, *, run: str, ends: Ends) -> dict[str, object]:
        """The answer of a finished ``run`` with its bins between other ``ends`` (m)."""
        return self._answer(self._stored(run), ends)

    def _answer(self, stored: StoredLandings, ends: Ends) -> dict[str, object]:
        shares, void = stored.result.between(ends).shares, stored.result.void

        def cells(numbers: Mapping[str, Number | None]) -> dict[str, object]:
            return {
                key: None if number is None else [number.value, *number.ends, percent(number, void=void)]
                for key, number in numbers.items()
            }

        return {
            "shares": {name: cells(row) for name, row in shares.fractions.items()},
            "purity": {place: cells(row) for place, row in shares.purity.items() if row},
            **{kind: cells(getattr(shares, kind)) for kind in ("recovery", "loss", "dirt")},
            "lost": {name: rate_words(number, void=void) for name, number in shares.lost.items()},
            "limits": _verdicts(stored, ends, shares),
        }

    def before(self, *, run: str) -> dict[str, object]:
        """A finished ``run`` next to the one before it with the same fractions and bins: both main numbers and what
        differs; nothing where there is none.
        """
        rows = runs_below(self.runs)[0]
        names = [str(row["name"]) for row in rows]
        place = names.index(run) if run in names else len(names)
        scenes = [scene_of(self.runs / name) for name in names[place:]]
        alike = [i for i, scene in enumerate(scenes) if i and parts_of(scene) == parts_of(scenes[0])]
        plain = [i for i in alike if run.endswith(CALIBRATED) and names[place + i] == run.removesuffix(CALIBRATED)]
        if not alike:
            return {"run": run, "other": None}
        earlier = [*plain, *alike][0]
        apart = "before its calibration" if plain else differs(scenes[earlier], scenes[0])
        table = compare([self.folder(names[place + earlier]), self.folder(run)]).table
        first, last = table.entries
        void = [entry.reason == VOID for entry in table.entries]
        differences = [(name, difference_of(first, last, name)) for name in main_quantities(table)]
        return {
            "run": run, "other": rows[place + earlier], "differs": apart,
            "rows": [
                [name.replace(".", " of ", 1).replace(".", ", "), percent(first.by_name.get(name), void=void[0]),
                 percent(last.by_name.get(name), void=void[1]),
                 VOID if any(void) else "" if less is None else difference_text(less), less is not None and less.clear]
                for name, less in differences
            ],
        }  # fmt: skip

    def compare(self, *, runs: tuple[str, ...]) -> dict[str, object]:
        """Write the page of several ``runs`` side by side; returns its name."""
        comparison = compare([self.folder(name) for name in runs])
        place = Path(tempfile.mkdtemp(dir=self._compared))
        with self._drawing:
            comparison.write(place)
        table = comparison.table
        differing = {key: [str(entry.inputs.get(key, "")) for entry in table.entries] for key in table.inputs}
        return {"page": place.name, "differs": differing}

    def sweep(self, *, sweep: str) -> dict[str, object]:
        """A sweep's points."""
        return points_of(inside(self.runs, sweep))


@lru_cache(KEPT)
def _landings_in(folder: Path, _: int) -> StoredLandings:
    return StoredLandings.of(Result.load(folder))


def _verdicts(stored: StoredLandings, ends: Ends, shares: Separation) -> list[str]:
    """Whether each limit of a run is kept with its bins between ``ends``, in the words of the report."""
    result = stored.result
    if dict(ends) == stored.ends:
        return verdict_lines(result)
    parts = {"loss": shares.loss, "dirt": shares.dirt}
    now = [(limit, parts[kind].get(of)) for limit in result.limits for kind, _, of in [limit.limit.partition(".")]]
    moved = [replace(limit, value=value, verdict=judged(result, value, limit.most), decides="") for limit, value in now]
    return verdict_lines(replace(result, limits=tuple(moved)))


TRACKS, CORNERS = 25, 150  # of a fraction that are drawn; of a track
ACROSS = 24  # arrows over the width of the channel


def within(result: Result) -> dict[str, object]:
    """Places (m) of some tracks by fraction; the mean ``air`` as rows x, y (m), u, v (m/s), none without air. Raises
    SceneError where the run left no report to draw from.
    """
    outcome = outcome_of(result)
    channel = outcome.scene.channel
    step = (channel.top - channel.bottom) / CORNERS
    tracks = {
        name: [
            np.round(_thinned(path.at(path.moments(step))[0]), 5).tolist() for path in map(Path2D.of, drawn[:TRACKS])
        ]
        for name, drawn in outcome.tracks.items()
    }
    if outcome.field is None:
        return {"tracks": tracks, "air": []}
    step = channel.width / ACROSS
    x = np.arange(-channel.width / 2 + step / 2, channel.width / 2, step)
    y = np.arange(channel.bottom + step / 2, channel.top, step)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    velocity = outcome.field.mean().sample(points)[0]
    rows = np.hstack([points, velocity])[np.isfinite(velocity).all(axis=1)]
    return {"tracks": tracks, "air": np.round(rows, 5).tolist()}


def _thinned(places: np.ndarray) -> np.ndarray:
    """Every so many of the places of a track, its end among them."""
    every = max(1, math.ceil(len(places) / CORNERS))
    return np.concatenate([places[:-1:every], places[-1:]])
