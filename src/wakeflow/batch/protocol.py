"""protocol(): what to weigh or count of a real machine, and how often, until a share is known twice as well.

What a measurement will leave of an interval does not depend on what it finds: the update of the shares
(:mod:`wakeflow.statistics.joint`) says it beforehand. The most useful lot is added, one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..answer.result import Result
from ..budget.agreement import joint_of
from ..core import sums
from ..core.errors import SceneError, known
from ..core.files import atomic_write, made_folder, path_of
from ..core.registry import did_you_mean
from ..pipeline.cache import Listener
from ..runs import run
from ..runs.progress import as_listener
from ..scene import RESERVED_BIN, Scene
from ..scene.measured import BY_CHANCE
from ..scene.whole import States
from ..statistics.joint import JointShares
from .calibration import widest_recovery
from .calibration_update import DISCREPANCY, discrepancy_of

if TYPE_CHECKING:
    from ..planning.plan import Plan

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
    scene: Scene | Path | str,
    out: Path | str | None = None,
    *,
    of: str | None = None,
    kernels: int = 300,
    rung: str | None = None,
    force: States | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
) -> Protocol:
    """Plan what to count of the machine of ``scene``, which is run where it has not been, until the share ``of``
    (a fraction: its recovery; FRACTION.BIN; by default the recovery that is known worst) is known twice as well;
    ``kernels`` of a fraction are fed in one repetition. Writes a page to print and the form that becomes measured.csv.

    Raises SceneError for a fraction or bin that there is not, and for fewer than ten kernels or more than a
    million.
    """
    asked = Scene.of(scene)
    _check(asked, of, kernels)
    if out is not None:
        _claim(path_of(out, "out"))
    heard, planned = as_listener(listener, planned)
    result = run(scene, out, rung=rung, force=force, workers=workers, listener=heard, planned=planned)
    return protocol_of(result, of, kernels)


def _check(scene: Scene, of: str | None, kernels: int) -> None:
    wanted_share(scene, of)
    if not 10 <= kernels <= MOST_KERNELS:
        raise SceneError(f"kernels = {kernels}: count ten at least, a million at most")


def protocol_of(result: Result, of: str | None = None, kernels: int = 300, out: Path | None = None) -> Protocol:
    """The same of a finished run, into the folder ``out`` or its own.

    Raises SceneError as :func:`protocol` does, and where the run ended before its shares.
    """
    scene = Scene.parse(result.scene)
    from ..report.html.protocol import write_protocol

    _check(scene, of, kernels)
    if result.landings is None:
        raise SceneError(f"{result.folder} holds no shares: the run ended before them")
    joint = _with_discrepancy(joint_of(result.landings), result)
    name, wanted = _weights(joint, scene, of)
    half, steps = joint.half(wanted), tuple(_steps(joint, wanted, list(scene.fraction), kernels))
    fractions = list(dict.fromkeys(step.fraction for step in steps)) or list(scene.fraction)[:1]
    folder = result.folder if out is None else made_folder(out)
    page, form = folder / PAGE, folder / FORM
    made = Protocol(
        name, half, steps, tuple(_important(joint, wanted, fractions, kernels)),
        _unsorted(joint, wanted, scene), page, form,
    )  # fmt: skip
    _claim(folder)
    with sums.writing(folder, lambda: [page, form], COMMAND):
        write_protocol(page, scene, made, fractions)
        with sums.replacing(form, COMMAND) as draft:
            _write_form(draft, scene, fractions)
    return made


def _claim(folder: Path) -> None:
    """Raise SceneError where a page is there that the program did not write, or a form that was filled in."""
    sums.refuse_foreign(folder, [folder / PAGE], COMMAND)
    sums.refuse_changed(folder / FORM, COMMAND)


def wanted_share(scene: Scene, of: str | None) -> tuple[str, Sequence[str]] | None:
    """The fraction and bins that ``of`` names; None where it names nothing. Raises SceneError for what is not there."""
    if of is None:
        return None
    name, _, place = of.partition(".")
    if name not in scene.fraction:
        raise SceneError(f"--of {of}: no fraction {name!r}{did_you_mean(name, list(scene.fraction))}")
    if place and place not in (*scene.bin, RESERVED_BIN):
        raise SceneError(f"--of {of}: no bin {place!r}{did_you_mean(place, list(scene.bin))}")
    if not place and not scene.fraction[name].targets:
        raise SceneError(f"--of {of}: {name} has no target; name a bin, --of {name}.{next(iter(scene.bin))}")
    return name, [place] if place else scene.fraction[name].targets


def _weights(joint: JointShares, scene: Scene, of: str | None) -> tuple[str, Array]:
    asked = wanted_share(scene, of)
    if asked is None:
        return widest_recovery(joint, scene)
    name, places = asked
    return f"{name} in {' or '.join(places)}", joint.tray(name, places)


def _with_discrepancy(joint: JointShares, result: Result) -> JointShares:
    shares = known(result.landings).separation.fractions
    own = discrepancy_of(joint.places, shares, DISCREPANCY)
    return JointShares(
        joint.keys, joint.places, joint.inputs, joint.spread, joint.shares, joint.covariance + own, joint.cross
    )


def _counted(joint: JointShares, fraction: str, kernels: int) -> tuple[Array, Array]:
    """Weights (n, S) of every tray of a fraction, and the covariance (n, n) of one repetition."""
    mine = [i for i, (name, _) in enumerate(joint.places) if name == fraction]
    weights = np.eye(len(joint.places))[mine]
    share = np.clip(joint.shares[mine], 0.0, 1.0) + BY_CHANCE / kernels
    share /= share.sum()
    chance = (np.diag(share) - np.outer(share, share)) / kernels
    return weights, chance + REPEATS**2 * np.diag(4.0 * share * (1.0 - share))


def _steps(joint: JointShares, wanted: Array, fractions: Sequence[str], kernels: int) -> Iterator[WeighingStep]:
    """Lots, each the one that leaves least of the interval, until half is left."""
    goal, lots = HALVED * joint.half(wanted), dict.fromkeys(fractions, 0)
    left = joint.half(wanted)
    while left > goal and sum(lots.values()) < MOST_LOTS:
        found = {name: _after(joint, {**lots, name: lots[name] + 1}, kernels).half(wanted) for name in fractions}
        best = min(found, key=lambda name: found[name])
        lots[best], left = lots[best] + 1, found[best]
        yield WeighingStep(best, kernels, lots[best], left)


def _after(joint: JointShares, lots: dict[str, int], kernels: int) -> JointShares:
    """What is known after so many repetitions of each fraction."""
    for name, count in lots.items():
        if count:
            weights, noise = _counted(joint, name, kernels)
            joint = joint.seen(weights, weights @ joint.shares, noise / count)
    return joint


def _important(joint: JointShares, wanted: Array, fractions: Sequence[str], kernels: int) -> Iterator[str]:
    """The trays that tell most, each alone, most first: those that take a fifth of the interval or more."""
    left, now = {}, joint.half(wanted)
    for name in fractions:
        weights, noise = _counted(joint, name, kernels)
        for row in range(len(weights)):
            alone = weights[row : row + 1]
            one = joint.seen(alone, alone @ joint.shares, noise[row : row + 1, row : row + 1])
            place = joint.places[int(np.argmax(weights[row]))][1]
            left[f"{name} in {place}"] = one.half(wanted) / max(now, 1e-12)
    yield from (about for about, part in sorted(left.items(), key=lambda one: one[1]) if part < 0.8)


def _unsorted(joint: JointShares, wanted: Array, scene: Scene) -> float:
    """Half of the interval once every tray was weighed as it is."""
    mass = scene.mass_shares()
    weights = np.array([
        [mass[name] if place == bin_ else 0.0 for name, bin_ in joint.places] for place in (*scene.bin, RESERVED_BIN)
    ])  # fmt: skip
    return joint.seen(weights, weights @ joint.shares, REPEATS**2 * np.eye(len(weights))).half(wanted)


def _write_form(path: Path, scene: Scene, fractions: Sequence[str]) -> None:
    """The form: a line a tray, to be filled in."""
    with atomic_write(path) as stream:
        stream.write("# Write into the third column how many kernels lay in the tray, all repetitions together;\n")
        stream.write(f"# {RESERVED_BIN}: those that reached no tray. Every line of a fraction is needed, even a 0.\n")
        stream.write("fraction,bin,count\n")
        stream.writelines(f"{name},{place},\n" for name in fractions for place in (*scene.bin, RESERVED_BIN))
