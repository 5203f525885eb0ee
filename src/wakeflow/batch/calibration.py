"""calibrate(): what measured shares say of the numbers that a scene does not say exactly, and of all other shares.

The draws of a run and the regression on them make every share linear in the unknown inputs; the measured shares update
both (:mod:`wakeflow.statistics.joint`). The granules are then flown again under draws of what came out, and the update
is made anew from what was known at first, until the inputs stay where they are. Next to the inputs the model has errors
of its own, which no measurement takes away: each share has a *discrepancy*, so that many exact trays do not make an
input known beyond what the model bears. What no inputs can explain shows in the chi-square, and is not fitted away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..answer.result import Request, Result, key_in
from ..answer.shares import BudgetPart, BudgetRow, BudgetTotal, InputPart, InputSummary, Separation
from ..budget.agreement import Agreement
from ..budget.budget import fly_again, make_budget
from ..budget.source import INPUTS, Flights
from ..core import sums
from ..core.errors import SceneError, known
from ..core.files import atomic_write, made_folder, path_of, write_json
from ..core.number import Number
from ..core.record import to_json
from ..core.store import cache_in_use, cache_root
from ..core.tables import CellTable
from ..pipeline.cache import Listener
from ..planning.unknowns import SIGMAS, Unknown, unknown_kinds
from ..runs import run
from ..runs.progress import as_listener
from ..runs.stages import one_thread_of_blas, stages_of
from ..scene import Scene
from ..scene.measured import Measured, Tray, read_trays, trays_of_columns
from ..scene.overrides import share_in
from ..scene.whole import States
from ..statistics.joint import JointShares
from ..statistics.separation import HOUR, purity_slopes, separate
from .calibrated_materials import materials_text
from .calibration_update import DISCREPANCY, Updated, updated

if TYPE_CHECKING:
    from ..planning.plan import Plan

Array = NDArray[np.float64]
TELLS = 0.9  # an input whose interval became narrower by this factor has learnt something
MEASURED_SHARES = "measured shares"
COMMAND, MATERIALS = "calibrate", "materials.toml"
TABLES = ("inputs.csv", "agreement.csv", "correlations.csv", "shares.csv", "calibration.json")


# -- The calibration of a scene ----------------------------------------------------------------------------------------
@dataclass(frozen=True)
class CalibratedInput:
    """One number of the scene: what was known of it ``before``, and what is known ``after`` the measurement."""

    key: str
    unit: str
    before: Number
    after: Number
    narrower: float

    value = property(lambda self: self.after.value)
    low = property(lambda self: self.after.low)
    high = property(lambda self: self.after.high)
    value_before = property(lambda self: self.before.value)
    low_before = property(lambda self: self.before.low)
    high_before = property(lambda self: self.before.high)


INPUT_COLUMNS = {
    "input": "key", "unit": "unit", "before": "value_before", "before low": "low_before", "before high": "high_before",
    "after": "value", "after low": "low", "after high": "high", "interval after over before": "narrower",
}  # fmt: skip


@dataclass(frozen=True)
class Posterior:
    """What a measurement makes of a scene: its ``inputs`` by key, those that learnt most first; the ``result`` with the
    new shares, recoveries and purities, next to the one ``before``; the ``agreement`` of the measurement with the
    model, whatever its inputs; each tray as it is known now (``trays``); the correlation of each pair of inputs that
    learnt something; of each tray how much wider the widest recovery would be without it (``wider_without``); what to
    measure next (``next``: what it would leave of the widest recovery's interval).
    """

    folder: Path
    before: Result
    result: Result
    inputs: Mapping[str, CalibratedInput]
    agreement: Agreement
    trays: tuple[Number, ...]
    correlations: tuple[tuple[str, str, float], ...]
    wider_without: tuple[tuple[str, float], ...]
    next: tuple[tuple[str, float], ...]
    rounds: int
    stands: bool
    source: str

    def save(self, path: Path | str) -> Path:
        """Write the materials file: ``materials = "..."`` at the head of the next scene takes it, each fraction that is
        fed here as the material ``measured-NAME``.

        Raises SceneError where the measurement disagrees with the model: what was fitted to it is worth nothing.
        """
        if self.agreement.verdict == "disagrees":
            raise SceneError(f"no materials are written: {self.agreement.sentence} Weigh it again, or mend the scene")
        file, scene = path_of(path, "materials file"), Scene.parse(self.before.scene)
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file) as stream:
            stream.write(materials_text(scene, {k: one.after for k, one in self.inputs.items()}, self.source))
        return file

    def cells(self) -> CellTable:
        """A row an input, as inputs.csv has it."""
        return CellTable.of(self.inputs.values(), INPUT_COLUMNS)


def calibrate(
    scene: Scene | Path | str,
    measured: Path | str | Mapping[str, Sequence[object]] | Sequence[Tray] | Any,
    out: Path | str | None = None,
    *,
    discrepancy: float | str = DISCREPANCY,
    rung: str | None = None,
    force: States | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
) -> Posterior:
    """Say what measured shares tell of the unknown numbers of ``scene``, and of all its shares.

    ``measured``: a CSV file (fraction, bin, share, uncertainty), columns by these names, or a frame of them. The scene
    is run where it has not been, in the folder ``out`` (as :func:`wakeflow.run`), where the files of the calibration
    are written too. ``discrepancy``: half of the 95 % interval by which the model itself may miss a share of a half,
    0.02 or "2 %".

    Raises SceneError for wrong input.
    """
    asked, trays, missed = Scene.of(scene), _trays_of(measured), share_in(discrepancy, "discrepancy")
    if not 0.0 < missed <= 0.5:
        raise SceneError(f"discrepancy = {discrepancy!r}: needs a share above 0, at most 0.5; no model is exact")
    found = Measured.of(trays)
    found.weights([(f, b) for f in asked.fraction for b in (*asked.bin, "elsewhere")], asked.mass_shares())
    heard, planned = as_listener(listener, planned)
    if out is not None:
        _claim(path_of(out, "out"))
    result = run(scene, out, rung=rung, force=force, workers=workers, listener=heard, planned=planned)
    update, scene_flown = _update(result, found, missed, workers, heard)
    posterior = _posterior(result, update, found, scene_flown, _source(measured))
    _write(posterior)
    return posterior


def _trays_of(measured: object) -> list[Tray]:
    """The trays of a file, of columns by their names, or as they are."""
    if isinstance(measured, Path | str):
        return read_trays(measured)
    if isinstance(measured, Sequence) and measured and all(isinstance(one, Tray) for one in measured):
        return list(measured)
    to_dict = getattr(measured, "to_dict", None)
    columns = to_dict("list") if to_dict is not None else measured
    if not isinstance(columns, Mapping):
        raise SceneError("measured: give a CSV file, columns by their names, or a frame of them")
    return trays_of_columns(columns)


def _source(measured: object) -> str:
    return Path(measured).name if isinstance(measured, Path | str) else "measured shares"


def _update(
    result: Result, measured: Measured, discrepancy: float, workers: int | None, listener: Listener
) -> tuple[Updated, Scene]:
    """The update of a finished run, whose stages come from the cache, and its scene as it was flown."""
    if result.void:
        raise SceneError(f"calibrate: the answer of {result.folder} is void, {result.warnings[0]}")
    request = Request(None, result.options.rung, result.options.force, result.options.target_error)
    with cache_in_use(cache_root()), one_thread_of_blas():
        pipeline, _ = stages_of(Scene.parse(result.scene), request, workers, listener)
        flights = Flights(pipeline, pipeline.tracks(), pipeline.crowd())
        fly_again(flights)
        shares = separate(pipeline.scene, flights.landings)
        budget = make_budget(flights, shares)
        return updated(flights, shares.fractions, budget, measured, discrepancy), pipeline.scene


# -- What came out -----------------------------------------------------------------------------------------------------
def separation_after(joint: JointShares, before: Separation, scene: Scene) -> Separation:
    """Shares, recoveries, purities and throughputs as they are known jointly."""
    mass, bins, joint = scene.mass_shares(), before.bins, joint.in_bounds()
    fractions = {
        name: {
            place: replace(joint.number(joint.tray(name, [place])), numerical=old[place].numerical) for place in bins
        }
        for name, old in before.fractions.items()
    }
    own = {name: {place: one.value for place, one in found.items()} for name, found in fractions.items()}
    recovery = {
        name: None if found is None else replace(
            joint.number(joint.tray(name, scene.fraction[name].targets)), numerical=found.numerical)
        for name, found in before.recovery.items()
    }  # fmt: skip
    throughput = {
        place: HOUR * scene.feed.mass_flow * sum(mass[name] * own[name][place] for name in own) for place in bins
    }
    purity = {
        place: None if before.purity[place] is None or sum(own[name][place] for name in own) <= 0.0
        else {name: _purity(joint, name, place, mass, own) for name in own}
        for place in bins
    }  # fmt: skip
    return replace(before, fractions=fractions, recovery=recovery, purity=purity, throughput=throughput, cut=())


def _purity(
    joint: JointShares, name: str, place: str, mass: Mapping[str, float], own: Mapping[str, Mapping[str, float]]
) -> Number:
    """By the slope of a purity with every fraction's share in the bin."""
    here = {other: found[place] for other, found in own.items()}
    value = mass[name] * here[name] / sum(mass[other] * here[other] for other in here)
    slopes = purity_slopes(name, mass, here)
    half = joint.half(sum((slopes[other] * joint.tray(other, [place]) for other in here), np.zeros(len(joint.places))))
    return Number(value, max(0.0, value - half), min(1.0, value + half))


def inputs_after(update: Updated) -> dict[str, CalibratedInput]:
    """What is known of every input, those whose interval became narrowest first."""
    found = []
    for place, one in enumerate(update.unknowns):
        at, apart = float(update.after.inputs[place]), float(np.sqrt(max(update.after.spread[place, place], 0.0)))
        low, high = (float(np.clip(one.at(at + side * SIGMAS * apart), *_span(one))) for side in (-1.0, 1.0))
        before = Number(one.value, *one.ends)
        found.append(CalibratedInput(one.key, one.unit, before, Number(one.at(at), low, high), apart))
    return {one.key: one for one in sorted(found, key=lambda one: one.narrower)}


def _span(one: Unknown) -> tuple[float, float]:
    return unknown_kinds[one.kind].span


def correlations_after(update: Updated) -> Iterator[tuple[str, str, float]]:
    """Of each pair of inputs that learnt something, the strongest first."""
    apart = np.sqrt(np.clip(np.diag(update.after.spread), 1e-12, None))
    learnt = [i for i, size in enumerate(apart) if size < TELLS]
    pairs = [
        (update.after.keys[i], update.after.keys[j], float(update.after.spread[i, j] / (apart[i] * apart[j])))
        for place, i in enumerate(learnt) for j in learnt[place + 1 :]
    ]  # fmt: skip
    yield from sorted(pairs, key=lambda pair: -abs(pair[2]))


def widest_recovery(joint: JointShares, scene: Scene) -> tuple[str, Array]:
    """The name and the weights (S,) of the recovery that is known worst; where no fraction has a target, of a share."""
    aimed = {name: one.targets for name, one in scene.fraction.items() if one.targets}
    wanted = {f"recovery of {name}": joint.tray(name, targets) for name, targets in aimed.items()}
    wanted = wanted or {f"{name} in {place}": joint.tray(name, [place]) for name, place in joint.places}
    return max(wanted.items(), key=lambda one: joint.half(one[1]))


def wider_without(update: Updated, measured: Measured, scene: Scene) -> list[tuple[str, float]]:
    """Of each tray how many times wider the interval of the recovery that was known worst would be without it."""
    weights = measured.weights(update.after.places, scene.mass_shares())
    wanted = widest_recovery(update.before, scene)[1]
    with_all, found = max(update.after.half(wanted), 1e-12), []
    for row, (fraction, place) in enumerate(measured.places):
        kept = [other for other in range(len(measured.places)) if other != row]
        without = update.before.seen(weights[kept], measured.shares[kept], measured.covariance[np.ix_(kept, kept)])
        found.append((f"{fraction or 'all fractions'} in {place}", without.half(wanted) / with_all))
    return sorted(found, key=lambda one: -one[1])


def measure_next_after(update: Updated, scene: Scene, most: int = 5) -> list[tuple[str, float]]:
    """Each input that is worth measuring, with the part of the widest recovery's interval that would be left once it
    were known exactly.
    """
    after, wanted = update.after, widest_recovery(update.after, scene)[1]
    total = float(wanted @ after.covariance @ wanted)
    if total <= 0.0:
        return []
    shared = (after.cross @ wanted) ** 2 / np.clip(np.diag(after.spread), 1e-12, None) / total
    left = [(key, float(np.sqrt(max(0.0, 1.0 - part)))) for key, part in zip(after.keys, shared, strict=True)]
    return sorted(left, key=lambda one: one[1])[:most]


def _posterior(before: Result, update: Updated, measured: Measured, scene: Scene, source: str) -> Posterior:
    landings = known(before.landings)
    separation, inputs = separation_after(update.after, landings.separation, scene), inputs_after(update)
    summary = {
        key: InputSummary(*one.after, unit=one.unit, why=f"{MEASURED_SHARES}, {source}") for key, one in inputs.items()
    }
    after = replace(
        landings, separation=separation, inputs=summary, measure_next=_parts(update.after), without_collisions=None,
        bracket=None, air_loading=None, three_dimensions=None, budget=tuple(_rows(separation)),
    )  # fmt: skip
    return Posterior(
        before.folder, before, replace(before, landings=after), inputs, update.agreement,
        tuple(map(update.after.number, measured.weights(update.after.places, scene.mass_shares()))),
        tuple(correlations_after(update)), tuple(wider_without(update, measured, scene)),
        tuple(measure_next_after(update, scene)), update.rounds, update.stands, source,
    )  # fmt: skip


def _rows(separation: Separation) -> Iterator[BudgetRow]:
    """The whole error of each share as one part: what is left once the shares were measured."""
    for name, places in separation.fractions.items():
        for place, one in places.items():
            low, high, half = one.low - one.value, one.high - one.value, max(one.high - one.value, one.value - one.low)
            part = BudgetPart(INPUTS, half, 0.0, "companion", low=low, high=high, note=f"after {MEASURED_SHARES}")
            total = BudgetTotal(half, 0.0, one.low, one.high, one.numerical)
            yield BudgetRow(f"share.{name}.{place}", None, (part,), total)


def _parts(joint: JointShares) -> dict[str, dict[str, dict[str, InputPart]]]:
    """Of each share what every input still does to it, with all that goes with that input, the largest first."""
    apart = np.sqrt(np.clip(np.diag(joint.spread), 1e-12, None))
    found: dict[str, dict[str, dict[str, InputPart]]] = {}
    for i, (name, place) in enumerate(joint.places):
        rises, total = SIGMAS * joint.cross[:, i] / apart, max(float(joint.covariance[i, i]), 1e-18)
        parts = {
            key: InputPart(abs(rise), (rise / SIGMAS) ** 2 / total, 0.0, rise)
            for key, rise in zip(joint.keys, map(float, rises), strict=True)
        }
        found.setdefault(name, {})[place] = dict(sorted(parts.items(), key=lambda one: -one[1].half))
    return found


def _files(folder: Path) -> list[Path]:
    from ..report.canvas import saved

    return [*(folder / name for name in (*TABLES, MATERIALS)), *saved(folder / "figures" / "calibration.png")]


def _claim(folder: Path) -> None:
    """Raise SceneError where a calibration in ``folder`` would replace what the program did not write, or materials
    that were changed since.
    """
    sums.refuse_foreign(folder, _files(folder), COMMAND)
    sums.refuse_changed(folder / MATERIALS, COMMAND)


def _write(found: Posterior) -> None:
    """The tables and the picture of a calibration into the folder of its run."""
    _claim(made_folder(found.folder))
    if key_in(found.folder) not in (None, found.before.key):
        raise SceneError(f"{found.folder} holds another answer now; the same command calibrates it")
    with sums.writing(found.folder, lambda: _files(found.folder), COMMAND):
        _write_tables(found, found.folder)
        materials = found.folder / MATERIALS
        if found.agreement.verdict == "disagrees":
            materials.unlink(missing_ok=True)
        else:
            with sums.replacing(materials, COMMAND) as draft:
                found.save(draft)


def _write_tables(found: Posterior, folder: Path) -> None:
    from ..report.figures.measured import draw_measured

    draw_measured(folder / "figures" / "calibration.png", found.agreement, found.trays)
    found.cells().write_csv(folder / "inputs.csv")
    found.agreement.cells().write_csv(folder / "agreement.csv")
    CellTable(("input", "other input", "correlation"), found.correlations).write_csv(folder / "correlations.csv")
    before, after = (known(one.landings).separation.fractions for one in (found.before, found.result))
    rows = [[n, p, *before[n][p], *one] for n, places in after.items() for p, one in places.items()]
    heads = ("fraction", "bin", "before", "before low", "before high", "after", "after low", "after high")
    CellTable(heads, rows).write_csv(folder / "shares.csv")
    write_json(folder / "calibration.json", {
        "verdict": found.agreement.verdict, "chi_square": found.agreement.chi_square,
        "freedom": found.agreement.freedom, "chance": found.agreement.chance, "rounds": found.rounds,
        "stands": found.stands, "wider_without": found.wider_without, "next": found.next,
        "inputs": {key: {"value": one.value, "low": one.low, "high": one.high} for key, one in found.inputs.items()},
        "separation": to_json(known(found.result.landings).separation),
    })  # fmt: skip
