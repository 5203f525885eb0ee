"""The answer of a run as a whole: what result.json holds, and the one way to write and to read it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..air.kinds.airflow_table import Airflow, MeshReport
from ..core import own_files
from ..core.errors import SceneError
from ..core.files import MAX_RECORD, check_tables, path_of, read_json, write_json
from ..core.graded import GRADES, Grade
from ..core.lazy import cached_property
from ..core.number import NO_NUMBER, Number, percent
from ..core.number import VOID as VOID
from ..core.quantities import quantity
from ..core.record import JsonMapping, JsonTable, column, columns, from_json, to_json
from ..core.registry import Registry, did_you_mean
from ..core.store import content_key
from ..core.tables import Columns, frame_of, load_arrays
from ..flight.feed.impact_loads import ImpactSummary
from ..planning.feed_funnel import FunnelSummary
from ..planning.plan import Plan
from ..planning.stage_cache import StageTime
from ..scene.overrides import share_in
from ..scene.rungs import check_rung
from ..scene.scene_tables import States, switched
from .cells import Ends
from .joint import JointAnswer
from .provenance import Provenance, Refinement
from .shares import SHARE_UNIT, BudgetRow, LandingResults, Separation, Verdict, WithShares, optional

if TYPE_CHECKING:
    from .shares import LandingResults, Separation


SCHEMA = 5
FILE = "result.json"
CHECKSUM = "sha256"  # key of result.json: of all that is beside it there
GRANULES = "granules.npz"
JOINT = "joint.npz"  # the ensemble from which every interval is taken
ENDS = ("from", "to")  # of a bin


@dataclass(frozen=True)
class Request:
    """How the run was asked for: all options that are not in its scene."""

    until: str | None = column("", "the last stage; null for all")
    rung: str | None = column("", "rung instead of the scene's own; null for that")
    force: dict[str, bool] = column("", "terms switched by hand")
    target_error: float | None = column("1", "error of a share instead of the scene's own; null for that")
    near: str | None = optional(
        "", "folder of the run whose airflow this one's starts from; left out where it starts from rest"
    )
    effort: str | None = optional(
        "",
        "settings that a quick answer or a budget brought: quick, coarse, medium or the scene's own; left out "
        "otherwise",
    )

    @classmethod
    def of(
        cls,
        until: str | None = None,
        rung: str | None = None,
        force: States | None = None,
        target_error: float | str | None = None,
        near: Path | str | None = None,
    ) -> Self:
        """The request of a caller from Python, who may write "on", "off" and "1 %". Raises SceneError where a part of
        it means nothing in any scene.
        """
        if rung is not None:
            check_rung(rung)
        error = None if target_error is None else share_in(target_error, "target_error")
        return cls(until, rung, switched(force), error, None if near is None else str(path_of(near, "near")))


@dataclass(frozen=True)
class FlightResults:
    """How the flights of all granules began and ended."""

    fates: dict[str, dict[str, int]] = column("1", "granules of each fraction by how their track ended")
    met_by_law: dict[str, int] = column("1", "granules of each fraction whose first impact follows eq. (2)")
    impact: ImpactSummary | None = column("", "what the stream does to the first body; null without one, and if tilted")


@dataclass(frozen=True)
class Calibration:
    """What an answer was calibrated with."""

    source: str = column("", "where the measured shares are from")
    conflict: str = column("", "what the scene says that contradicts them; empty where nothing does")
    agreement: str = column("", "agreement of the shares with what was known before them, in a sentence")


FLAT = {"flights": FlightResults, "landings": LandingResults}  # parts whose keys are among those of result.json


@dataclass(frozen=True)
class PictureSummary:
    """A picture that the scene asked for."""

    kind: str = column("", "kind of picture")
    files: tuple[str, ...] = column("", "files in figures/, the PNG first")
    text: str = column("", "what it shows, with its numbers")
    numbers: JsonTable = column("as the picture", "its numbers, by the kind of picture")


@dataclass(frozen=True, kw_only=True)
class Result(WithShares):
    """A finished run: its folder and what result.json holds, as types; ``table`` is the same as plain JSON.

    Read one with :meth:`load`. Parts that a run with ``until`` did not reach are None.
    """

    folder: Path = field(default=Path())
    schema: int = column("1", "version of this table")
    scene: JsonTable = column("SI", "the scene as asked for, in SI units: docs/scenes.md")
    options: Request = column("", "how the run was asked for")
    plan: Plan = column("", "what is computed and what is not")
    funnel: FunnelSummary | None = column("", "the feed funnel; null without one")
    airflow: Airflow | None = column("", "the airflow; null at rung none and until it is there")
    mesh: MeshReport | None = optional("", "the mesh; left out without air")
    flights: FlightResults | None = column("", "left out of a run that ends before the tracks", flat=True)
    landings: LandingResults | None = column("", "left out of a run that ends before the shares", flat=True)
    limits: tuple[Verdict, ...] = column("", "whether each limit of the scene is kept", default=())
    warnings: tuple[str, ...] = column("", "what a user must know, the gravest first")
    grades: tuple[str, ...] = column("", GRADES)
    seconds: dict[str, StageTime] = column("", "every stage by name, with the label of its airflow before it")
    versions: dict[str, str] = column("", "versions of python and of the packages")
    key: str = column("", "fingerprint of all that the answer depends on")
    pictures: dict[str, PictureSummary] | None = optional("", "what the scene asked for; left out before the tracks")
    provenance: Provenance = column("", "when, where and with what it was made")
    calibration: Calibration | None = optional(
        "", "calibration of an answer that measured shares were put into; left out of any other"
    )
    refinement: Refinement | None = optional("", "how a target error was met; left out of a run without one")

    @classmethod
    def load(cls, folder: Path | str) -> Self:
        """The finished run in ``folder``. Raises SceneError where there is none, or one of another version."""
        return cls.from_json(folder, _read(folder))

    @classmethod
    def from_json(cls, folder: Path | str, table: object) -> Self:
        """The result whose result.json holds ``table``. Raises SceneError, naming the key, where it is not one."""
        if isinstance(table, dict):
            table = dict(table)
            if table.get("schema") != SCHEMA:
                raise SceneError(f"{Path(folder) / FILE} is of another version of wakeflow; {_cure(folder)}")
            for name, kind in FLAT.items():
                inside = {head.key: table.pop(head.key) for head in columns(kind) if head.key in table}
                table |= {name: inside or None}
        result = replace(from_json(cls, table, str(Path(folder) / FILE)), folder=Path(folder))
        if wrong := next(mistakes_in(result), None):
            raise SceneError(f"{Path(folder) / FILE}: {wrong}; {_cure(folder)}")
        return result

    def to_json(self) -> JsonTable:
        """What result.json holds."""
        table: JsonTable = to_json(replace(self, folder=Path()))
        del table["folder"]
        for name in FLAT:
            table |= table.pop(name) or {}
        return table

    def save(self) -> None:
        """Write result.json into the folder: what :meth:`to_json` makes, and the checksum of it."""
        table = self.to_json()
        write_json(self.folder / FILE, table | {CHECKSUM: content_key(table)})

    @cached_property
    def table(self) -> JsonTable:
        """What result.json holds, as plain JSON."""
        return self.to_json()

    @property
    def separation(self) -> JsonTable:
        """Bins, shares, purity, recovery and throughput, as plain JSON. Raises KeyError before there are any."""
        return dict(self.table["separation"])

    @cached_property
    def plot(self) -> Any:
        """The pictures, each on axes of your own: ``result.plot.tracks(axes)``; see :mod:`wakeflow.show.views`."""
        return accessors["plot"](self)

    @property
    def budget(self) -> tuple[BudgetRow, ...]:
        """The error of every share and landing place; empty before there are any."""
        return () if self.landings is None else self.landings.budget

    @cached_property
    def joint(self) -> JointAnswer:
        """All shares jointly: what every interval is taken from. Raises SceneError where the run ended before the
        shares, or its arrays are missing or damaged.
        """
        record = None if self.landings is None else self.landings.joint
        if record is None:
            raise SceneError(f"{self.folder} holds no shares: the run ended before them")
        file, cure = self.folder / JOINT, _cure(self.folder)
        if not file.is_file():
            raise SceneError(f"{self.folder} holds no {JOINT}; {cure}")
        own_files.check(self.folder, JOINT, cure)
        try:
            return JointAnswer.of(record, load_arrays(file, cure))
        except (KeyError, ValueError, IndexError, TypeError):
            raise SceneError(f"{file} is damaged; {cure}") from None

    def with_joint(self, joint: JointAnswer) -> Self:
        """This result with its shares jointly, before they are in its folder."""
        vars(self)["joint"] = joint
        return self

    def moved(self, changes: Mapping[str, object]) -> MovedBins:
        """The answer with some bins moved, nothing flown: ``{"bin.near.to": "90 mm", "bin.far.from": "90 mm"}``, keys
        as of ``Scene.replace``, lengths in m or with their unit.

        Raises SceneError where the run ended before the shares, for another key, and for bins that overlap.
        """
        ends = dict(self.joint.cells.ends)
        for key, value in changes.items():
            kind, _, rest = key.partition(".")
            name, _, end = rest.rpartition(".")
            if kind != "bin" or end not in ENDS or name not in ends:
                known = [f"bin.{bin_}.{side}" for bin_ in ends for side in ENDS]
                raise SceneError(f"moved: {key!r} is no end of a bin on a side of this run{did_you_mean(key, known)}")
            low, high = ends[name]
            place = _length(key, value)
            ends[name] = (place, high) if end == "from" else (low, place)
        return self.between(ends)

    def between(self, ends: Ends) -> MovedBins:
        """The answer with its bins between other ``ends`` (m, from and to by bin), as :meth:`moved`."""
        return MovedBins(self.joint.moved(ends).separation())

    def frame(self) -> Any:
        """The shares, a row for each fraction and bin: ``share`` by mass, ``low`` and ``high`` of its 95 % interval,
        ``target``: whether the fraction should land there.

        A pandas DataFrame where pandas is installed, else a dict of numpy arrays. Raises SceneError where the run ended
        before the shares.
        """
        rows = [(name, *share) for name, places in self._shares.fractions.items() for share in places.items()]
        return frame_of({
            "fraction": np.array([name for name, _, _ in rows], dtype=object),
            "bin": np.array([place for _, place, _ in rows], dtype=object),
            "share": np.array([number.value for _, _, number in rows]),
            "low": np.array([number.low for _, _, number in rows]),
            "high": np.array([number.high for _, _, number in rows]),
            "target": np.array([place in self.targets(name) for name, place, _ in rows]),
        })  # fmt: skip

    def granules(self) -> Any:
        """Where granules ended, a row for each of those that the run keeps, ``numerics.keep`` of each fraction:
        fraction, bin, x and y (m), diameter (m), time (s) since the feed began, impacts, fate (``wf.Fate``), weight (of
        the feed's mass).

        A pandas DataFrame where pandas is installed, else a dict of numpy arrays. Raises SceneError where the run ended
        before the tracks.
        """
        table = kept_granules(self.folder)
        bins = np.array([*self._shares.bins], dtype=object)  # elsewhere is the last, and -1 in the file
        names = np.array(table["names"], dtype=object)
        x, y = table["position"].T
        plain = {name: table[name] for name in ("diameter", "time", "impacts", "fate", "weight")}
        return frame_of({"fraction": names[table["fraction"]], "bin": bins[table["bin"]], "x": x, "y": y, **plain})

    @property
    def _shares(self) -> Separation:
        if self.landings is None:
            raise SceneError(f"{self.folder} holds no shares: the run ended before them")
        return self.landings.separation

    @property
    def void(self) -> bool:
        """Whether a warning says that the answer is worth nothing."""
        return Grade.VOID.value in self.grades

    @property
    def why_void(self) -> str:
        """The gravest warning, which says why the answer is void; empty where it is not."""
        return self.warnings[self.grades.index(Grade.VOID.value)] if self.void else ""

    @property
    def lacking(self) -> tuple[str, ...]:
        """The parts of the error of any share whose size nobody knows: no interval holds them."""
        rows = (row for row in self.budget if row.measure == SHARE_UNIT)
        return tuple(dict.fromkeys(part.source for row in rows for part in row.parts if part.error is None))

    @property
    def caveat(self) -> str:
        """What is against the intervals in a word: that the answer is void, or what they lack; empty without."""
        if self.void:
            return VOID
        return f"without {', '.join(self.lacking)}" if self.lacking else ""

    def __repr__(self) -> str:
        """The folder, and what is recovered of each fraction, with its 95 % interval, and what is wrong with that."""
        if self.landings is None:
            return f"<Result {self.folder}: ended after {self.options.until}>"
        if self.void:
            return f"<Result {self.folder}: {VOID}>"
        recovery = self.landings.separation.recovery
        parts = ", ".join(f"{name} {percent(number)} %" for name, number in recovery.items() if number is not None)
        flaw = f"; {self.caveat}" if self.caveat else ""
        return f"<Result {self.folder}: recovery {parts or 'of nothing: no fraction has a target'}{flaw}>"

    def _repr_html_(self) -> str:
        """The table of shares, as a notebook shows it."""
        return str(accessors["html"](self))

    def targets(self, fraction: str) -> tuple[str, ...]:
        """The bins where a fraction should land; empty when the scene names none."""
        target = self.scene["fraction"].get(fraction, {}).get("target") or ()
        return (target,) if isinstance(target, str) else tuple(target)


def replaced(result: Result, **changes: Any) -> Result:
    """A result with other columns, and with its shares jointly, where it has them already."""
    changed = replace(result, **changes)
    return changed.with_joint(result.joint) if "joint" in vars(result) else changed


@dataclass(frozen=True)
class MovedBins(WithShares):
    """The answer of a run with its bins elsewhere: shares, purities, recoveries and throughputs of ``shares``."""

    shares: Separation

    @property
    def _shares(self) -> Separation:
        return self.shares


def _length(key: str, value: object) -> float:
    """A length in m, of a number or a text with its unit. Raises SceneError for anything else."""
    try:
        if isinstance(value, str):
            return quantity(value, "m", "90 mm")
        if isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value):
            return float(value)
    except ValueError as problem:
        raise SceneError(f"{key} = {value!r}: {problem}") from None
    raise SceneError(f"{key} = {value!r}: needs a number in m or a string such as '90 mm'")


accessors: Registry[Callable[[Result], Any]] = Registry("view of a result")


def _read(folder: Path | str) -> JsonTable:
    """The table of result.json without its checksum. Raises SceneError where there is none, or it is damaged."""
    path = path_of(folder, "folder of a run") / FILE
    try:
        table: JsonTable = read_json(path)
    except (FileNotFoundError, NotADirectoryError):
        raise _unfinished(folder) from None
    except SceneError as problem:
        raise SceneError(f"{problem}; {_cure(folder)}") from None
    try:
        check_tables(table, str(path), MAX_RECORD)
        noted, checksum = table.pop(CHECKSUM, None), content_key(table)
    except (SceneError, AttributeError, TypeError, ValueError):  # deep, no table, a number beyond all numbers
        raise SceneError(f"{path} is damaged; {_cure(folder)}") from None
    if noted not in (None, checksum):  # results of earlier versions have none
        raise SceneError(f"{path} is damaged: its checksum is another; {_cure(folder)}")
    return table


def _cure(folder: Path | str) -> str:
    return f"make it again with: wakeflow run SCENE --out {quote(str(folder))}"


def _unfinished(folder: Path | str) -> SceneError:
    place = Path(folder)
    if place.is_file():
        return SceneError(f"{folder} is a file; name the folder of a finished run")
    inside = sorted(path.parent.name for path in place.glob(f"*/{FILE}"))
    if inside:
        return SceneError(f"{folder} is no run but holds some, {', '.join(inside)}: name {place / inside[0]}")
    return SceneError(f"{folder} holds no finished run; make one with: wakeflow run SCENE --out {quote(str(folder))}")


def request_in(folder: Path | str, *, whole: bool = True) -> tuple[JsonTable, Request]:
    """The scene and the request of the finished run in ``folder``, which may be one of an older version, and where it
    need not be ``whole`` one that ended before the shares.

    Raises SceneError where there is none.
    """
    table = _read(folder)
    try:
        scene, options = table["scene"], table["options"]
        if whole and "separation" not in table:
            raise SceneError(f"the run in {folder} ended before its shares; run its scene again without --until")
        return scene, Request(None, options["rung"], options["force"], options.get("target_error"), options.get("near"))
    except (KeyError, TypeError):
        raise _unfinished(folder) from None


def refinement_in(folder: Path | str) -> Refinement | None:
    """How the settings of the finished run in ``folder`` came about; None where it had no target error.

    Raises SceneError where there is no run.
    """
    table = _read(folder).get("refinement")
    return None if table is None else from_json(Refinement, table, str(Path(folder) / FILE))


def provenance_in(folder: Path | str, key: str) -> Provenance | None:
    """When, where and with what the answer in ``folder`` was made, where it is that of ``key``; None without one."""
    if key_in(folder) != key:
        return None
    table = _read(folder).get("provenance")
    return None if table is None else from_json(Provenance, table, str(Path(folder) / FILE))


def key_in(folder: Path | str) -> str | None:
    """What the answer in ``folder`` was made for; None when there is none."""
    try:
        key = _read(folder)["key"]
    except (SceneError, KeyError, TypeError):
        return None
    return key if isinstance(key, str) else None


def kept_granules(folder: Path) -> Columns:
    """The arrays of granules.npz in a run's ``folder``, by name. Raises SceneError where there is none, or it is
    damaged or not of the scene of that run.
    """
    file = folder / GRANULES
    if not file.is_file():
        raise SceneError(f"{folder} holds no {GRANULES}: the run ended before its tracks")
    cure = f"wakeflow report {quote(str(folder))} writes it anew"
    own_files.check(folder, GRANULES, cure)
    table, result = load_arrays(file, cure), Result.load(folder)
    bins = np.inf if result.landings is None else len(result.landings.separation.bins)
    if not are_granules(table, set(result.scene["fraction"]), bins):
        raise SceneError(f"{file} is damaged; {cure}")
    return table


# -- What a result that is read must hold whatever it is about: numbers in intervals, shares that sum to one -----------
ROUNDED = 1e-6  # by how much sums and ends of intervals may be off


def mistakes_in(result: Result) -> Iterator[str]:
    """What is wrong with a result: each in words that name the key."""
    yield from _in_scene(result.scene)
    yield from _in_numbers(result, "")
    if result.landings is not None:
        for name in ("separation", "without_collisions"):
            if (shares := getattr(result.landings, name)) is not None:
                yield from _in_shares(shares, name)
        yield from _in_inputs(result.landings)


def _in_scene(scene: JsonMapping) -> Iterator[str]:
    """Fractions that are no tables, and targets that name no bins."""
    fractions = scene.get("fraction")
    if not isinstance(fractions, Mapping) or not all(isinstance(fraction, Mapping) for fraction in fractions.values()):
        yield "scene.fraction is no table of fractions"
        return
    for name, fraction in fractions.items():
        target = fraction.get("target") or []
        if not isinstance(target, str | list | tuple) or not all(isinstance(place, str) for place in target):
            yield f"scene.fraction.{name}.target names no bins"


def _in_inputs(landings: LandingResults) -> Iterator[str]:
    """Inputs that nothing is known of, and numbers of the answer that there are not, in what inputs do to it."""
    shares, inputs = landings.separation.fractions, landings.inputs
    targets = {f"recovery.{name}" for name in shares}
    targets |= {f"purity.{place}.{name}" for name, places in shares.items() for place in places}
    moved = {f"of_targets.{name}": parts for name, parts in landings.of_targets.items()}
    for name in landings.of_targets:
        if name not in targets:
            yield f"of_targets.{name} is no recovery and no purity of the answer"
    for name, places in landings.measure_next.items():
        for place, parts in places.items():
            moved[f"measure_next.{name}.{place}"] = parts
            if place not in shares.get(name, {}):
                yield f"measure_next.{name}.{place} is no share of the answer"
    for where, parts in moved.items():
        if unknown := [key for key in parts if key not in inputs]:
            yield f"{where}.{unknown[0]} is none of the inputs"


def _in_numbers(value: object, place: str) -> Iterator[str]:
    """Numbers that are none, and intervals that do not hold their number."""
    if isinstance(value, Number) and value is not NO_NUMBER:
        slack = ROUNDED * max(1.0, abs(value.value)) if math.isfinite(value.value) else 0.0
        if not value.low - slack <= value.value <= value.high + slack:  # of NaN neither
            yield f"{place} = {value.value:.6g} is outside of its interval, {value.low:.6g} to {value.high:.6g}"
    elif isinstance(value, Mapping):
        for key, member in value.items():
            yield from _in_numbers(member, f"{place}.{key}".removeprefix("."))
    elif isinstance(value, tuple | list):
        for number, member in enumerate(value, 1):
            if not isinstance(member, float | int | str):
                yield from _in_numbers(member, f"{place}[{number}]")
    elif is_dataclass(value):
        for member in fields(value):
            yield from _in_numbers(getattr(value, member.name), f"{place}.{member.name}".removeprefix("."))


def _in_shares(part: Separation, name: str) -> Iterator[str]:
    for fraction, places in part.fractions.items():
        if set(places) != set(part.bins):
            yield f"{name}.fractions.{fraction}: its bins are not those of the scene"
        for place, share in places.items():
            if not 0.0 <= share.value <= 1.0:
                yield f"{name}.fractions.{fraction}.{place} = {share.value:.6g} is no share, 0 to 1"
        total = sum(share.value for share in places.values())
        if abs(total - 1.0) > ROUNDED:
            yield f"{name}.fractions.{fraction}: its shares sum to {total:.6g}, not to 1"
    pure = ((place, purity) for place, row in part.purity.items() for purity in (row or {}).values())
    for key, number in (*part.recovery.items(), *part.loss.items(), *part.dirt.items(), *pure):
        if number is not None and not -ROUNDED <= number.value <= 1.0 + ROUNDED:
            yield f"{name}: {number.value:.6g} of {key} is no share, 0 to 1"
    for place, rate in part.throughput.items():
        if not 0.0 <= rate < math.inf:
            yield f"{name}.throughput.{place} = {rate:.6g} is no rate"


# of granules.npz: a row for each granule that is kept
KEPT = ("fraction", "weight", "position", "bin", "diameter", "fate", "time", "impacts")


def are_granules(table: Columns, fractions: Set[str], bins: float) -> bool:
    """Whether the arrays of granules.npz are those of an answer: granules of its ``fractions``, in one of so many
    ``bins`` (infinitely many where it ended before it had any), somewhere, with a size and a mass.
    """
    if set(table) != {"names", *KEPT} or not all(table[name].dtype.kind in "iuf" for name in KEPT):
        return False
    names, fraction, place, mass = (table[name] for name in ("names", "fraction", "bin", "weight"))
    shapes = {"position": (mass.size, 2)}
    return bool(
        all(table[name].shape == shapes.get(name, (mass.size,)) for name in KEPT)
        and all(np.isfinite(table[name]).all() for name in KEPT)
        and fraction.dtype.kind in "iu"
        and place.dtype.kind in "iu"
        and names.shape == (len(fractions),)
        and set(names.tolist()) == fractions
        and ((fraction >= 0) & (fraction < len(fractions))).all()
        and (place >= -1).all()  # elsewhere, which is the last of the bins
        and (place < bins - 1).all()
        and (table["diameter"] > 0).all()
        and (mass >= 0).all()
        and (np.bincount(fraction.astype(int), mass)[fraction] > 0).all()  # a fraction weighs something
    )
