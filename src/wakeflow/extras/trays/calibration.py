"""calibrate(): what measured shares say of the numbers that a scene does not say exactly, and of all other shares.

The joint answer of a run is moved to where it is as measured (:mod:`.calibration_update`). Where the numbers as stated
cannot reach the trays, what would have to be otherwise is found first, as history matching does with a conflict of
prior and data (White et al. 2020, PEST++ v5, 9.1.13): the input whose stated uncertainty must grow least, or else how
far the model itself must miss shares. What nothing explains is not calibrated.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...answer.budget.agreement import Agreement, of_tray, weights_in
from ...answer.budget.source import INPUTS
from ...answer.joint import JointAnswer, Of, effects_in
from ...answer.result import Calibration, Request, Result
from ...answer.shares import PERTURBED_RERUN, BudgetPart, BudgetRow, BudgetTotal, InputSummary, Separation
from ...core import own_files
from ...core.errors import SceneError, known
from ...core.files import atomic_write, path_of, write_json
from ...core.number import Number
from ...core.record import to_json
from ...core.store import content_key
from ...core.tables import CellTable
from ...laws.restitution import Restitution
from ...planning.stage_cache import Listener
from ...runs.one_run import OneRun, folder_of, running
from ...runs.planned import make_plan
from ...runs.progress import as_listener
from ...scene import Fraction, Scene
from ...scene.fraction import MAX_COEFFICIENT, Coefficient
from ...scene.measured import Measured, Tray, read_trays, trays_of_columns
from ...scene.overrides import share_in
from ...scene.scene_tables import States
from .calibration_update import DISCREPANCY, Matched, Updated, half_of, left_by, matched

if TYPE_CHECKING:
    from ...planning.plan import Plan

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


INPUT_HEADS = (
    "input", "unit", "before", "before low", "before high", "after", "after low", "after high",
    "interval after over before",
)  # fmt: skip


@dataclass(frozen=True)
class Posterior:
    """What a measurement makes of a scene: its ``inputs`` by key, those that learnt most first; the ``result`` with the
    new shares, recoveries and purities, next to the one ``before``; the ``agreement`` of the measurement with what the
    scene says; the ``conflict``: what would have to be otherwise for the two to agree, empty where they do; each tray
    as it is known now (``trays``); the correlation of each pair of inputs that learnt something; of each tray how much
    wider the widest recovery would be without it (``wider_without``); what to measure next (``next``: what it would
    leave of the widest recovery's interval). Where nothing agrees there is no ``result`` and nothing is known of any
    input.
    """

    folder: Path
    before: Result
    agreement: Agreement
    conflict: str
    source: str
    result: Result | None = None
    inputs: Mapping[str, CalibratedInput] = field(default_factory=dict)
    trays: tuple[Number, ...] = ()
    correlations: tuple[tuple[str, str, float], ...] = ()
    wider_without: tuple[tuple[str, float], ...] = ()
    next: tuple[tuple[str, float], ...] = ()
    rounds: int = 0
    stands: bool = False

    def save(self, path: Path | str) -> Path:
        """Write the materials file: ``materials = "..."`` at the head of the next scene takes it, each fraction that is
        fed here as the material ``measured-NAME``.

        Raises SceneError where the measurement contradicts what the scene says of its inputs.
        """
        if self.conflict:
            raise SceneError(f"no materials are written: {self.conflict} Weigh it again, or mend the scene")
        file, scene = path_of(path, "materials file"), Scene.parse(self.before.scene)
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file) as stream:
            stream.write(materials_text(scene, {key: entry.after for key, entry in self.inputs.items()}, self.source))
        return file

    def cells(self) -> CellTable:
        """A row an input, as inputs.csv has it."""
        rows = [[entry.key, entry.unit, *entry.before, *entry.after, entry.narrower] for entry in self.inputs.values()]
        return CellTable(INPUT_HEADS, rows)


def calibrate(
    scene: Scene | Path | str, measured: Path | str | Mapping[str, Sequence[object]] | Sequence[Tray] | Any,
    out: Path | str | None = None, *, discrepancy: float | str = DISCREPANCY, rung: str | None = None,
    force: States | None = None, workers: int | None = None, listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
) -> Posterior:  # fmt: skip
    """Say what measured shares tell of the unknown numbers of ``scene``, and of all its shares.

    ``measured``: a CSV file (fraction, bin, share, uncertainty), columns by these names, or a frame of them. The scene
    is run where it has not been, in the folder ``out`` (as :func:`wakeflow.run`), where the files of the calibration
    are written too. ``discrepancy``: half of the 95 % interval by which the model itself may miss a share of a half,
    0.02 or "2 %".

    Raises SceneError for wrong input.
    """
    scene, trays, missed = Scene.of(scene), Measured.of(_trays_of(measured)), share_in(discrepancy, "discrepancy")
    if not 0.0 < missed <= 0.5:
        raise SceneError(f"discrepancy = {discrepancy!r}: needs a share above 0, at most 0.5; no model is exact")
    trays.weights([(f, b) for f in scene.fraction for b in (*scene.bin, "elsewhere")], scene.mass_shares())
    source = Path(measured).name if isinstance(measured, Path | str) else MEASURED_SHARES
    listener, planned = as_listener(listener, planned)
    request, folder = Request.of(rung=rung, force=force), folder_of(scene, out)
    if why := make_plan(scene, rung=rung, force=request.force).why_void:
        raise SceneError(f"calibrate: the answer would be void: {why}")
    _claim(folder)
    with running(scene, folder, request, workers=workers, listener=listener, planned=planned, report=False) as run:
        result = run.result()
        if result.void:
            raise SceneError(f"calibrate: the answer of {folder} is void, {result.warnings[0]}")
        posterior = _posterior(result, matched(run, result.joint, trays, missed), trays, source)
        _write(posterior, replace(run, report=True))
    return posterior


def _trays_of(measured: object) -> list[Tray]:
    """The trays of a file, of columns by their names, or as they are."""
    if isinstance(measured, Path | str):
        return read_trays(measured)
    if isinstance(measured, Sequence) and measured and all(isinstance(tray, Tray) for tray in measured):
        return list(measured)
    heads = getattr(measured, "columns", None)
    columns = measured if heads is None else {head: measured[head] for head in heads}  # type: ignore[index]
    if not isinstance(columns, Mapping):
        raise SceneError("measured: give a CSV file, columns by their names, or a frame of them")
    return trays_of_columns(columns)


# -- What came out -----------------------------------------------------------------------------------------------------
def inputs_after(update: Updated) -> dict[str, CalibratedInput]:
    """What is known of every input, those whose interval became narrowest first."""
    entries = []
    for place, unknown in enumerate(update.unknowns):
        narrower = float(update.z[:, place].std() / update.before.z[:, place].std())
        before, after = Number(unknown.value, *unknown.ends), update.known(place)
        entries.append(CalibratedInput(unknown.key, unknown.unit, before, after, narrower))
    return {entry.key: entry for entry in sorted(entries, key=lambda entry: entry.narrower)}


def correlations_after(update: Updated) -> Iterator[tuple[str, str, float]]:
    """Correlation of each pair of inputs that learnt something, the strongest first."""
    apart = update.z.std(axis=0) / np.maximum(update.before.z.std(axis=0), 1e-12)
    learnt = [i for i, size in enumerate(apart) if 0.0 < size < TELLS]
    together = np.atleast_2d(np.corrcoef(update.z.T))
    keys = update.before.keys
    pairs = [(keys[i], keys[j], float(together[i, j])) for place, i in enumerate(learnt) for j in learnt[place + 1 :]]
    yield from sorted(pairs, key=lambda pair: -abs(pair[2]))


def widest_recovery(joint: JointAnswer) -> tuple[str, Of]:
    """The recovery that is known worst and its name; where no fraction has a target, a share."""
    bins = joint.own
    wanted = {
        f"recovery of {name}": bins.of_share(name, targets) for name, targets in joint.targets.items() if targets
    } or {f"{name} in {place}": bins.of_share(name, [place]) for name in joint.fractions for place in bins.names}
    return max(wanted.items(), key=lambda item: bins.number(item[1]).half)


def wider_without(update: Updated, measured: Measured) -> list[tuple[str, float]]:
    """Factor, for each tray, by which the interval of the recovery that was known worst would be wider without it;
    never wider than with no tray at all.
    """
    before, weights = update.before, weights_in(update.before, measured)
    of = widest_recovery(before)[1]
    wanted, noise = before.own.values(of)[0], measured.covariance
    after = max(half_of(update.after.own.values(of)[0]), 1e-12)
    every, most, times_wider = max(left_by(before, wanted, weights, noise), 1e-12), half_of(wanted) / after, []
    for row, (fraction, place) in enumerate(measured.places):
        kept = [other for other in range(len(measured.places)) if other != row]
        without = left_by(before, wanted, weights[kept], noise[np.ix_(kept, kept)]) if kept else half_of(wanted)
        times = max(1.0, min(without / every, most))
        times_wider.append((f"{fraction or 'all fractions'} in {place}", times))
    return sorted(times_wider, key=lambda item: -item[1])


def measure_next_after(after: JointAnswer, most: int = 5) -> list[tuple[str, float]]:
    """Each input that is worth measuring, with the part of the widest recovery's interval that would be left once it
    were known exactly.
    """
    of = widest_recovery(after)[1]
    total = after.own.number(of).half
    if total <= 0.0:
        return []
    left = [(key, min(1.0, after.own.known_better(of, {key: 0.0}).half / total)) for key in after.keys]
    return sorted(left, key=lambda item: item[1])[:most]


def _posterior(before: Result, agreed: Matched, measured: Measured, source: str) -> Posterior:
    if not agreed.updates:
        return Posterior(before.folder, before, agreed.agreement, agreed.conflict, source)
    [update] = agreed.updates
    landings, bins, inputs = known(before.landings), update.after.own, inputs_after(update)
    separation = _numerical(bins.separation(), landings.separation)
    summary = {
        key: InputSummary(*input.after, unit=input.unit, why=f"{MEASURED_SHARES}, {source}")
        for key, input in inputs.items()
    }
    parts, of_targets = effects_in(bins)
    after = replace(
        landings, separation=separation, inputs=summary, measure_next=parts, of_targets=of_targets,
        without_collisions=None, bracket={}, air_loading={}, three_dimensions={},
        budget=tuple(_rows(separation)), joint=update.after.record(),
    )  # fmt: skip
    key = content_key("calibrated", before.key, repr(measured), update.discrepancy, agreed.conflict)
    calibration = Calibration(source, agreed.conflict, agreed.agreement.sentence)
    trays = tuple(update.after.own.number(of_tray(row)) for row in weights_in(update.after, measured))
    result = replace(before, landings=after, key=key, calibration=calibration).with_joint(update.after)
    return Posterior(
        before.folder, before, agreed.agreement, agreed.conflict, source, result, inputs, trays,
        tuple(correlations_after(update)), tuple(wider_without(update, measured)),
        tuple(measure_next_after(update.after)), update.rounds, update.stands,
    )  # fmt: skip


def _numerical(after: Separation, before: Separation) -> Separation:
    """What computing adds is as it was, but for what the trays say of that too."""

    def alike(share: Number, then: Number) -> Number:
        return replace(share, numerical=None if then.numerical is None else min(then.numerical, share.half))

    fractions = {
        name: {place: alike(share, before.fractions[name][place]) for place, share in places.items()}
        for name, places in after.fractions.items()
    }
    recovery = {name: share and alike(share, known(before.recovery[name])) for name, share in after.recovery.items()}
    return replace(after, fractions=fractions, recovery=recovery)


def _rows(separation: Separation) -> Iterator[BudgetRow]:
    """The whole error of each share as one part: what is left once the shares were measured."""
    for name, places in separation.fractions.items():
        for place, share in places.items():
            low, high, half = (
                share.low - share.value,
                share.high - share.value,
                max(share.high - share.value, share.value - share.low),
            )
            part = BudgetPart(INPUTS, half, 0.0, PERTURBED_RERUN, low=low, high=high, note=f"after {MEASURED_SHARES}")
            total = BudgetTotal(half, 0.0, share.low, share.high, share.numerical)
            yield BudgetRow(f"share.{name}.{place}", None, (part,), total)


def _files(folder: Path) -> list[Path]:
    from ...show.canvas import saved

    return [*(folder / name for name in (*TABLES, MATERIALS)), *saved(folder / "figures" / "calibration.png")]


def _claim(folder: Path) -> None:
    """Raise SceneError where a calibration in ``folder`` would replace what the program did not write, or materials
    that were changed since.
    """
    own_files.refuse_foreign(folder, _files(folder), COMMAND)
    own_files.refuse_changed(folder / MATERIALS, COMMAND)


def _write(posterior: Posterior, run: OneRun) -> None:
    """The tables and the picture of a calibration, and the calibrated answer as that of its run, into its folder."""
    _claim(posterior.folder)
    with own_files.writing(posterior.folder, lambda: _files(posterior.folder), COMMAND):
        _write_tables(posterior, posterior.folder)
        materials = posterior.folder / MATERIALS
        if posterior.conflict:
            materials.unlink(missing_ok=True)
        else:
            with own_files.replacing(materials, COMMAND) as draft:
                posterior.save(draft)
    answer = posterior.before if posterior.result is None else posterior.result
    run.written(answer.with_joint(answer.joint), run.flights.landings)


def _write_tables(posterior: Posterior, folder: Path) -> None:
    from ...show.figures.budget_figures import draw_measured

    draw_measured(folder / "figures" / "calibration.png", posterior.agreement, posterior.trays)
    posterior.cells().write_csv(folder / "inputs.csv")
    posterior.agreement.cells().write_csv(folder / "agreement.csv")
    CellTable(("input", "other input", "correlation"), posterior.correlations).write_csv(folder / "correlations.csv")
    after = None if posterior.result is None else known(posterior.result.landings).separation
    before = known(posterior.before.landings).separation.fractions
    rows = [] if after is None else [
        [n, p, *before[n][p], *share] for n, places in after.fractions.items() for p, share in places.items()
    ]  # fmt: skip
    heads = ("fraction", "bin", "before", "before low", "before high", "after", "after low", "after high")
    CellTable(heads, rows).write_csv(folder / "shares.csv")
    write_json(folder / "calibration.json", {
        "verdict": posterior.agreement.verdict, "chi_square": posterior.agreement.chi_square,
        "freedom": posterior.agreement.freedom, "chance": posterior.agreement.chance, "conflict": posterior.conflict,
        "rounds": posterior.rounds, "stands": posterior.stands, "wider_without": posterior.wider_without,
        "next": posterior.next,
        "inputs": {
            key: dict(zip(("value", "low", "high"), entry.after, strict=True))
            for key, entry in posterior.inputs.items()
        },
        "separation": None if after is None else to_json(after),
    })  # fmt: skip


HEAD = """# Granules as measured shares made them known. Put materials = "{file}" at the head of a scene, and
# material = "{example}" into its fraction. The intervals are those of each number alone; how they go together
# is in correlations.csv of the calibration. What is not of a fraction (air, feed, wake) is in inputs.csv.
"""
PREFIX = "measured-"
PARTS = ("terminal_velocity", "restitution", "friction", "rebound_scatter")


def materials_text(scene: Scene, inputs: Mapping[str, Number], source: str) -> str:
    """The file as TOML. ``inputs``: what is known of the numbers of the scene, by key; ``source``: of what."""
    names = list(scene.fraction)
    text = HEAD.format(file="materials.toml", example=PREFIX + names[0])
    return text + "".join(_material(name, scene.fraction[name], inputs, source) for name in names)


def _material(name: str, fraction: Fraction, inputs: Mapping[str, Number], source: str) -> str:
    properties = fraction.properties
    known = {part: inputs.get(f"fraction.{name}.{part}") for part in (*PARTS, "density", "size")}
    diameter, density = (known[part] for part in ("size", "density"))
    why = f"calibrated with {source}"
    lines = [
        "", f"[{PREFIX}{name}]", f"diameter = {properties.diameter if diameter is None else diameter.value:.6g}",
        f"density = {properties.density if density is None else density.value:.6g}", 'confidence = "measured"',
        f"source = {_quoted(why)}",
    ]  # fmt: skip
    for part in PARTS:
        value = getattr(properties, part)
        if value is None or isinstance(value, Restitution):
            continue  # a sphere's drag; a law of the speed of approach stays with the scene
        number = known[part]
        table: dict[str, Any] = {"value": float(value) if number is None else number.value}
        if part != "rebound_scatter":
            table["std"] = _std(fraction, part)
        if number is not None:
            table["uncertainty"] = max(number.half, 1e-9)
        lines += _part(f"{PREFIX}{name}.{part}", table, why if number is not None else "as in the scene")
    if isinstance(properties.restitution, Restitution):
        table = {"value": float(properties.restitution(np.ones(1))[0]), "std": 0.0}
        lines += _part(f"{PREFIX}{name}.restitution", table,
                       "at an approach of 1 m/s; the scene's law is not in this file")  # fmt: skip
    if properties.tangential_restitution:
        table = {"value": properties.tangential_restitution}
        lines += _part(f"{PREFIX}{name}.tangential_restitution", table, "as in the scene")
    lines += _part(f"{PREFIX}{name}.impact", {"model": fraction.impact_model}, "as in the scene")
    return "\n".join(lines) + "\n"


def _part(head: str, table: Mapping[str, Any], source: str) -> list[str]:
    texts = {key: _quoted(value) if isinstance(value, str) else f"{value:.6g}" for key, value in table.items()}
    rows = [f"{key} = {text}" for key, text in texts.items()]
    return [f"[{head}]", *rows, 'confidence = "measured"', f"source = {_quoted(source)}"]


def _quoted(text: str) -> str:
    """A text as TOML has it, which unlike JSON knows no halves of a letter and no bare DEL."""
    whole = text.encode(errors="replace").decode()
    return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")


def _std(fraction: Fraction, part: str) -> float:
    """How a number differs from granule to granule, as in the scene or its material."""
    given = getattr(fraction, part)
    if isinstance(given, Coefficient):
        p = np.array([0.158655, 0.841345])
        low, high = given.quantile(p, MAX_COEFFICIENT.get(part, np.inf))
        return float(high - low) / 2
    return 0.0 if given is not None else float(getattr(fraction.spread_material, f"{part}_std"))
