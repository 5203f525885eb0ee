"""protocol(): what to weigh or count of a real machine, and how often, until a share is known twice as well.

What a measurement will leave of an interval is the part of the number's draws that does not go with what the trays of
the same draws would show (:func:`.calibration_update.left_by`). The most useful lot is added, one at a time.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...answer.draws import ErrorSource, tied_root
from ...answer.joint import JointAnswer, Of
from ...answer.result import Result
from ...core import own_files
from ...core.errors import SceneError
from ...core.files import atomic_write, made_folder, path_of
from ...core.registry import did_you_mean
from ...planning.stage_cache import Listener
from ...runs import run
from ...runs.progress import as_listener
from ...scene import RESERVED_BIN, Scene
from ...scene.measured import BY_CHANCE
from ...scene.scene_tables import States
from ...show.canvas import bins_across
from ...show.html.rows import page_template
from ...show.sketch import draw_sketch
from .calibration import widest_recovery
from .calibration_update import DISCREPANCY, half_of, left_by, missed_by

if TYPE_CHECKING:
    from ...planning.plan import Plan

Array = NDArray[np.float64]
HALVED = 0.5  # of the interval: what is asked for
REPEATS = 0.01  # standard deviation of a share between repetitions of one machine, beyond counting. Chosen
MOST_LOTS = 12  # repetitions of all fractions together: who needs more measures something else
MOST_KERNELS = 1_000_000  # in a repetition: nobody counts more
COMMAND, PAGE, FORM = "protocol", "protocol.html", "measured.csv"


@dataclass(frozen=True)
class WeighingStep:
    """One lot after those before it: the ``fraction`` whose kernels are counted, so many ``kernels`` a repetition, how
    many ``repetitions`` of it there are by now; half of the 95 % interval of the wanted share that is left then.
    """

    fraction: str
    kernels: int
    repetitions: int
    half: float

    @property
    def about(self) -> str:
        """The step in words."""
        return f"{self.fraction}: count every tray"


@dataclass(frozen=True)
class Protocol:
    """What to count: the ``wanted`` share in words, ``half`` of its interval now, the ``steps``, which ``trays`` matter
    most, what weighing each tray unsorted would leave (``unsorted``); files: the ``page`` to print and the ``form``.
    """

    wanted: str
    half: float
    steps: tuple[WeighingStep, ...]
    trays: tuple[str, ...]
    unsorted: float
    page: Path
    form: Path

    @property
    def left(self) -> float:
        """Half of the interval after all steps."""
        return self.steps[-1].half if self.steps else self.half

    @property
    def sentence(self) -> str:
        """What it comes to."""
        does = "This halves" if self.left <= HALVED * self.half else "This does not halve"
        return (
            f"{does} the interval of {self.wanted}: ± {100 * self.half:.1f} "
            f"to ± {100 * self.left:.1f} points. All trays weighed as they are, unsorted, would leave "
            f"± {100 * self.unsorted:.1f}. Fill in {self.form.name}, then: wakeflow calibrate SCENE {self.form}"
        )


def protocol(
    scene: Scene | Path | str, out: Path | str | None = None, *, of: str | None = None, kernels: int = 300,
    rung: str | None = None, force: States | None = None, workers: int | None = None, listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
) -> Protocol:  # fmt: skip
    """Plan what to count of the machine of ``scene``, which is run where it has not been, until the share ``of``
    (a fraction: its recovery; FRACTION.BIN; by default the recovery that is known worst) is known twice as well;
    ``kernels`` of a fraction are fed in one repetition. Writes a page to print and the form that becomes measured.csv.

    Raises SceneError for a fraction or bin that there is not, and for fewer than ten kernels or more than a
    million.
    """
    scene = Scene.of(scene)
    _check(scene, of or "", kernels)
    if out is not None:
        _claim(path_of(out, "out"))
    heard, planned = as_listener(listener, planned)
    result = run(scene, out, rung=rung, force=force, workers=workers, listener=heard, planned=planned)
    return protocol_of(result, of or "", kernels)


def _check(scene: Scene, of: str, kernels: int) -> None:
    wanted_share(scene, of)
    if not 10 <= kernels <= MOST_KERNELS:
        raise SceneError(f"kernels = {kernels}: count ten at least, a million at most")


def protocol_of(result: Result, of: str = "", kernels: int = 300, out: Path | None = None) -> Protocol:
    """Plan what to count after a finished run, as :func:`protocol` does, into the folder ``out`` or its own.

    Raises SceneError as :func:`protocol` does, and where the run ended before its shares.
    """
    scene = Scene.parse(result.scene)
    _check(scene, of, kernels)
    if result.landings is None:
        raise SceneError(f"{result.folder} holds no shares: the run ended before them")
    name, number = _wanted(result.joint, scene, of)
    known = _Known.of(result.joint, number)
    half, steps = known.half, tuple(_steps(known, list(scene.fraction), kernels))
    fractions = list(dict.fromkeys(step.fraction for step in steps)) or list(scene.fraction)[:1]
    folder = result.folder if out is None else made_folder(out)
    page, form = folder / PAGE, folder / FORM
    made = Protocol(
        name, half, steps, tuple(_important(known, fractions, kernels)), _unsorted(known), page, form,
    )  # fmt: skip
    _claim(folder)
    with own_files.writing(folder, lambda: [page, form], COMMAND):
        write_protocol(page, scene, made, fractions)
        with own_files.replacing(form, COMMAND) as draft:
            _write_form(draft, scene, fractions)
    return made


def _claim(folder: Path) -> None:
    """Raise SceneError where a page is there that the program did not write, or a form that was filled in."""
    own_files.refuse_foreign(folder, [folder / PAGE], COMMAND)
    own_files.refuse_changed(folder / FORM, COMMAND)


def wanted_share(scene: Scene, of: str) -> tuple[str, Sequence[str]]:
    """The fraction and bins that ``of`` names, neither where it is empty. Raises SceneError for what is not there."""
    if not of:
        return "", ()
    name, _, place = of.partition(".")
    if name not in scene.fraction:
        raise SceneError(f"--of {of}: no fraction {name!r}{did_you_mean(name, list(scene.fraction))}")
    if place and place not in (*scene.bin, RESERVED_BIN):
        raise SceneError(f"--of {of}: no bin {place!r}{did_you_mean(place, list(scene.bin))}")
    if not place and not scene.fraction[name].targets:
        raise SceneError(f"--of {of}: {name} has no target; name a bin, --of {name}.{next(iter(scene.bin))}")
    return name, [place] if place else scene.fraction[name].targets


def _wanted(joint: JointAnswer, scene: Scene, of: str) -> tuple[str, Of]:
    name, places = wanted_share(scene, of)
    if not name:
        return widest_recovery(joint)
    return f"{name} in {' or '.join(places)}", joint.own.of_share(name, places)


@dataclass(frozen=True)
class _Known:
    """What is known of a number before anything is weighed: ``half`` of its 95 % interval, as the answer says; its
    draws (``wanted``) in a ``joint`` answer whose model may miss shares, which no tray of another bin shows.
    """

    joint: JointAnswer
    half: float
    wanted: Array

    @classmethod
    def of(cls, joint: JointAnswer, number: Of) -> _Known:
        roots = np.stack([tied_root(row) for row in missed_by(joint, DISCREPANCY)])
        missing = replace(joint, sources=(*joint.sources, ErrorSource("discrepancy", roots, computing=False)))
        return cls(missing, joint.own.number(number).half, missing.own.values(number)[0])

    def left(self, weights: Array, noise: Array, key: str = "") -> float:
        """Half of the interval once trays, ``weights`` (n, shares), are measured with the covariance ``noise``."""
        return self.half * left_by(self.joint, self.wanted, weights, noise, key) / max(half_of(self.wanted), 1e-12)


def _counted(joint: JointAnswer, fraction: str, kernels: int) -> tuple[Array, Array]:
    """Weights (n, shares) of every tray of a fraction, and the covariance (n, n) of one repetition."""
    number, bins = joint.fractions.index(fraction), len(joint.own.names)
    weights = np.eye(len(joint.fractions) * bins)[number * bins : (number + 1) * bins]
    share = np.clip(joint.own.value[number], 0.0, 1.0) + BY_CHANCE / kernels
    share /= share.sum()
    chance = (np.diag(share) - np.outer(share, share)) / kernels
    return weights, chance + REPEATS**2 * np.diag(4.0 * share * (1.0 - share))


def _steps(known: _Known, fractions: Sequence[str], kernels: int) -> Iterator[WeighingStep]:
    """Lots, each the one that leaves least of the interval, until half is left."""
    goal, lots, left = HALVED * known.half, dict.fromkeys(fractions, 0), known.half
    while left > goal and sum(lots.values()) < MOST_LOTS:
        halves = {name: _after(known, {**lots, name: lots[name] + 1}, kernels) for name in fractions}
        best = min(halves, key=lambda name: halves[name])
        lots[best], left = lots[best] + 1, min(left, halves[best])
        yield WeighingStep(best, kernels, lots[best], left)


def _after(known: _Known, lots: dict[str, int], kernels: int) -> float:
    """Half of the interval that is left after so many repetitions of each fraction."""
    rows = [(*_counted(known.joint, name, kernels), count) for name, count in lots.items() if count]
    noise = [spread / count for _, spread, count in rows]
    return known.left(np.vstack([weights for weights, _, _ in rows]), _blocks(noise))


def _blocks(parts: Sequence[Array]) -> Array:
    """One covariance of several that are independent."""
    many = sum(len(part) for part in parts)
    covariance, at = np.zeros((many, many)), 0
    for part in parts:
        covariance[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return covariance


def _important(known: _Known, fractions: Sequence[str], kernels: int) -> Iterator[str]:
    """The trays that tell most, each alone, most first: those that take a fifth of the interval or more."""
    left: dict[str, float] = {}
    for name in fractions:
        weights, noise = _counted(known.joint, name, kernels)
        for row, place in enumerate(known.joint.own.names):
            half = known.left(weights[row : row + 1], noise[row : row + 1, row : row + 1])
            left[f"{name} in {place}"] = half / max(known.half, 1e-12)
    yield from (about for about, part in sorted(left.items(), key=lambda item: item[1]) if part < 0.8)


def _unsorted(known: _Known) -> float:
    """Half of the interval once every tray was weighed as it is."""
    bins = len(known.joint.own.names)
    weights = np.hstack([mass * np.eye(bins) for mass in known.joint.mass])
    return known.left(weights, REPEATS**2 * np.eye(bins))


def _write_form(path: Path, scene: Scene, fractions: Sequence[str]) -> None:
    """The form: a line a tray, to be filled in."""
    with atomic_write(path) as stream:
        stream.write("# Write into the third column how many kernels lay in the tray, all repetitions together;\n")
        stream.write(f"# {RESERVED_BIN}: those that reached no tray. Every line of a fraction is needed, even a 0.\n")
        stream.write("fraction,bin,count\n")
        stream.writelines(f"{name},{place},\n" for name in fractions for place in (*scene.bin, RESERVED_BIN))


def write_protocol(path: Path, scene: Scene, planned: Any, fractions: Sequence[str]) -> None:
    """Write the page of a protocol (:class:`wakeflow.extras.trays.protocol.Protocol`) of ``scene``, with a form for
    each of the ``fractions`` that are counted.
    """
    picture = io.BytesIO()
    draw_sketch(scene).figure.savefig(picture, format="png")
    repetitions = {name: max(step.repetitions for step in planned.steps if step.fraction == name)
                   for name in dict.fromkeys(step.fraction for step in planned.steps)}  # fmt: skip
    text = page_template("protocol.html.j2", Path(__file__).parent).render(
        protocol=planned, repetitions=repetitions or dict.fromkeys(fractions, 1),
        bins=[*bins_across(scene), RESERVED_BIN], sketch=base64.b64encode(picture.getvalue()).decode("ascii"),
    )  # fmt: skip
    with atomic_write(path) as stream:
        stream.write(text)
