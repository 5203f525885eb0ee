"""What a history of drag, lift and base pressure says so far: means with 95 % intervals, and whether they suffice.

The signals are cut into whole shedding periods (from one rise of the lift through its mean to the next). The start-up
ends where each quantity first comes as near to its mean over the later half of the periods as these are wont to be
(after Fishman's rule of crossing the mean, "Concepts and Methods in Discrete Event Digital Simulation", 1973) and half
as many periods again. The intervals are those of a first-order autoregressive sequence with a value a period: Student's
t, widened by sqrt((1 + r)/(1 - r)) for the correlation r of neighbours, and by what a significant drift would still
change. Few periods tell little of r: it counts with USUAL, as if so many periods more (WEIGHT) had shown that.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.number import NO_NUMBER, Number, student
from .case import read_parameters

# -- Force coefficients and base pressure against time, of a running or finished case ----------------------------------
CD, CL = 1, 3  # columns of coefficient.dat in OpenFOAM 1912: Time Cd Cs Cl ...; in others see _placed
ABSENT = 1e100  # what OpenFOAM writes for a probe outside the mesh is larger
WIGGLE = 0.5  # of the signal's rms: a rise through the mean counts once the signal was so far below. Chosen
AGAIN = 0.5  # autocorrelation that a periodic signal reaches again after it was negative. Chosen


def read_table(case: Path, what: str, columns: tuple[int, ...]) -> Array:
    """Rows (n, 1 + c) of time and ``columns`` (none: all) of ``postProcessing/WHAT/*/*``, each restart replacing what
    it computed again.
    """
    rows = _parsed("", columns)
    folder = case / "postProcessing" / what
    starts = sorted(folder.iterdir(), key=lambda path: float(path.name)) if folder.is_dir() else []
    for start in starts:
        for path in sorted((p for p in start.iterdir() if p.is_file()), key=lambda p: p.stat().st_mtime):
            text = path.read_text()
            rows = _joined(rows, _parsed(text, _placed(text, columns)))
    return rows


def read_vectors(case: Path, what: str) -> Array:
    """Rows (n, 1 + 3 c): time and the c vectors that velocity probes wrote; probes outside the mesh are left out."""
    table = read_table(case, what, ())
    return table[:, (np.abs(table) < ABSENT).all(axis=0)]


def _placed(text: str, columns: tuple[int, ...]) -> tuple[int, ...]:
    """``columns`` with CL where the table's head has Cl: behind the parts of Cd in openfoam.com's later releases."""
    head = re.search(r"^# Time\s.*\sCl\s", text, re.M)
    return tuple(len(head[0].split()) - 2 if head and item == CL else item for item in columns)


def _parsed(text: str, columns: tuple[int, ...]) -> Array:
    """Time and ``columns`` of the whole lines of a table, whose vectors are in brackets and comments behind #."""
    lines = re.sub("[()]", " ", text[: text.rfind("\n") + 1]).splitlines()
    words = [row for row in map(str.split, lines) if row and row[0][0] != "#"]
    chosen = (0, *columns) if columns else range(len(words[0]) if words else 1)
    rows = [[float(row[i]) for i in chosen] for row in words if len(row) > max(chosen)]
    return np.array(rows).reshape(-1, len(chosen))


def _joined(rows: Array, new: Array) -> Array:
    """``rows`` with the ``new`` ones in place of those that are no earlier."""
    if not (len(rows) and len(new)):
        return new if len(new) else rows
    return np.concatenate([rows[: np.searchsorted(rows[:, 0], new[0, 0])], new])


class Tail:
    """Rows (time, Cd, Cl, base pressure coefficient) of a growing case: what is there, then what each :meth:`update`
    finds. The pressure is the mean of the probes on the body less the inlet's, over half the squared inlet speed; 0 in
    a case that does not record it.
    """

    def __init__(self, case: Path) -> None:
        self.case = case
        self.parts = [HistoryTable(case, "forceCoefficients", (CD, CL))]
        speed = read_parameters(case).get("inletSpeed")
        self.dynamic = None if speed is None else 0.5 * float(speed) ** 2
        if self.dynamic:
            self.parts += [HistoryTable(case, "basePressure", ()), HistoryTable(case, "inletPressure", (1,))]

    def update(self) -> Array:
        """All rows (n, 4) so far."""
        forces, *pressures = (part.update() for part in self.parts)
        if self.dynamic is None or not all(len(part) for part in pressures):
            return np.column_stack([forces, np.zeros(len(forces))])
        base, inlet = pressures
        last = min(base[-1, 0], inlet[-1, 0]) * (1 + 1e-6)  # one file may lag by a line, and their times have 6 digits
        forces = forces[forces[:, 0] <= last]
        at_base, at_inlet = (np.interp(forces[:, 0], part[:, 0], part[:, 1:].mean(axis=1)) for part in (base, inlet))
        return np.column_stack([forces, (at_base - at_inlet) / self.dynamic])


class HistoryTable:
    """Rows (n, 1 + c) of one function object's output, as of :func:`read_table`, read on from the last look."""

    def __init__(self, case: Path, what: str, columns: tuple[int, ...]) -> None:
        self.folder, self.columns = case / "postProcessing" / what, columns
        self.rows = read_table(case, what, columns)
        self.known = {path: path.stat().st_mtime_ns for path in self._files()}
        self.path, self.at = Path(), 0  # of the file that grows: none so far

    def _files(self) -> list[Path]:
        return [path for path in self.folder.glob("*/*") if path.is_file()]

    def update(self) -> Array:
        """All rows so far; a restart replaces what it computes again."""
        if self.path == Path():
            growing = (path for path in self._files() if path.stat().st_mtime_ns != self.known.get(path))
            self.path = next(growing, self.path)
        if self.path != Path():
            with self.path.open("rb") as stream:
                stream.seek(self.at)
                text = stream.read()
            text = text[: text.rfind(b"\n") + 1]
            self.at += len(text)
            self.columns = _placed(text.decode(), self.columns)
            self.rows = _joined(self.rows, _parsed(text.decode(), self.columns))
        return self.rows


def upward_crossings(time: Array, signal: Array, typical: Array | None = None) -> Array:
    """Times at which ``signal`` rises through its mean, to second order; wiggles below half its rms do not count.

    Mean and rms are those of ``typical``, by default of the signal itself.
    """
    typical = signal if typical is None else typical
    deviation = signal - typical.mean()
    level = WIGGLE * float(typical.std())
    if level == 0:
        return np.zeros(0)
    side = np.where(deviation > level, 1, np.where(deviation < -level, -1, 0))
    clear = np.flatnonzero(side)
    turns = np.flatnonzero((side[clear][:-1] < 0) & (side[clear][1:] > 0))
    times = []
    for low, high in zip(clear[turns], clear[turns + 1], strict=True):
        part = deviation[low : high + 1]
        i = low + int(np.flatnonzero((part[:-1] <= 0) & (part[1:] > 0))[-1])
        times.append(float(time[i] - deviation[i] * (time[i + 1] - time[i]) / (deviation[i + 1] - deviation[i])))
    return np.array(times)


def kind_of(signal: Array, tolerance: float) -> str:
    """steady | periodic | broadband: range within ``tolerance`` of the mean; autocorrelation above 0.5 again;
    neither.
    """
    if spread(signal) <= tolerance:
        return "steady"
    return "periodic" if oscillation(signal) else "broadband"


def spread(signal: Array) -> float:
    """Range over mean."""
    return float(np.ptp(signal)) / max(abs(float(signal.mean())), 1e-12)


def oscillation(signal: Array) -> int:
    """Rows after which a signal repeats: the first peak of its autocorrelation above 0.5 after it was negative, looked
    for up to half the signal's length; 0 without one, and for a signal at rest.
    """
    deviation = signal - float(signal.mean())
    spectrum = np.fft.rfft(deviation, 2 * len(deviation))
    lagged = np.fft.irfft(np.abs(spectrum) ** 2)[: len(deviation) // 2]
    if not len(lagged) or lagged[0] <= 0:
        return 0
    lagged = lagged / lagged[0] * len(deviation) / (len(deviation) - np.arange(len(lagged)))
    negative = np.flatnonzero(lagged < 0)
    again = np.flatnonzero(lagged[negative[0] :] > AGAIN) if len(negative) else negative
    if not len(again):
        return 0
    first = int(negative[0] + again[0])
    fallen = np.flatnonzero(lagged[first:] <= AGAIN)
    return first + int(lagged[first : first + fallen[0] if len(fallen) else None].argmax())


Array = NDArray[np.float64]
# Chosen by trials on records of known statistics (tests/unit/air/test_statistics.py) where no source is given.
MIN_PERIODS = 6  # whole periods after the start-up
PIECES = 32  # of a wake without a rhythm
BATCHES = 8  # parts that a drift is looked for in, at most about twice as many
USUAL, WEIGHT = 0.1, 20  # correlation of neighbouring periods before any is seen, and periods that it counts for
FEW = 20  # periods whose intervals may be twice as wide as they seem; see `Statistics.stands`
MARGIN = 1.5  # of the periods up to the crossing: what is left of the start-up there goes too
DRIFTING = 3.0  # t statistic of a slope over the batches that a stationary signal seldom reaches (2 % at 8 batches)
SHARED = -0.6  # periods share their ends: what one is longer by, its neighbour is shorter; not trusted beyond this
OFTEN = 1.3  # looked at often, a spread that is small by chance ends the run: wider by what that costs in trials
SURE = 0.4  # of the width asked: so narrow that the fewest periods are enough
RESOLVED = 0.05  # of the half-width asked: no interval is narrower, slower changes than the run lasted go unseen
MIN_DRAG = 0.1  # Cd, and as a share of Cd the lift's rms: smaller ones are measured against this (see `wanted`)
MIN_PRESSURE = 0.5  # base pressure coefficient: the same
STRONGEST = 0.8  # correlation of neighbouring periods, at most: a stronger one cannot be estimated from few
NO_SLOWING = 0.9  # ratio of successive thirds' changes with which a drift that does not slow down is extrapolated
SHORTEST = 0.1  # of the mean period: the lower end of its interval is no lower
FAINT = 0.01  # of the drag: lift below it has no rhythm of its own
# A wake at rest: for REST convective times, after REST_AFTER at the earliest, nothing moves by more than RESTING of the
# drag, of the base pressure coefficient (or of 1), and of a lift coefficient of 1.
RESTING = 1e-3
REST, REST_AFTER = 10.0, 30.0  # convective times
LATER = 0.1  # of the record: so much more of it before it is looked at again
LOOSER = {"cd": 1.0, "strouhal": 2.0, "cp_base": 1.0, "cl_rms": 2.0}  # times the accuracy asked; see `wanted`
PERIODIC = {"length": 0.01, "drag": 0.01, "lift": 0.03}  # relative spread from period to period of a periodic wake


@dataclass(frozen=True)
class Statistics:
    """Means since ``begin`` (s, the end of the start-up) over ``periods`` whole periods of mean length ``period`` (s).

    ``frequency`` (1/s) is none and ``period`` 0 where the lift shows no shedding; the mean is then taken over equal
    pieces of the record. ``cp_base`` is in the units of the history. ``excess``: the largest of half-width over the
    half-width asked; the answer is settled when it is at most 1.
    """

    begin: float
    period: float
    periods: int
    cd: Number
    cl_rms: Number
    frequency: Number
    cp_base: Number
    excess: float
    verdict: str

    def __bool__(self) -> bool:
        """Whether there are any, :data:`NOTHING` being none."""
        return self.periods > 0

    @property
    def stands(self) -> bool:
        """Whether every interval is as narrow as asked, or the narrower the fewer periods show it: the spread of few is
        often small by chance. That also keeps the run's end from following that chance: of n periods it asks for
        intervals that fall far faster than as 1/sqrt(n).
        """
        return self.excess <= max(SURE, 1.0 / (1.0 + (FEW / self.periods) ** 3))


NOTHING = Statistics(0.0, 0.0, 0, NO_NUMBER, NO_NUMBER, NO_NUMBER, NO_NUMBER, np.inf, "broadband")


def evaluate(rows: Array, accuracy: float) -> Statistics:
    """The statistics of ``rows`` (n, 4): time (s), Cd, Cl, base pressure coefficient; NOTHING with too few periods.

    ``accuracy``: half-width of the 95 % intervals asked, relative; see :func:`wanted` for small values. An interval
    covers what the mean would become if the run went on; not the error of mesh, time step or model.
    """
    table = cycles(rows)
    shedding = len(table) > 0
    if not shedding:
        table = _pieces(rows)
    if len(table) < MIN_PERIODS:
        return NOTHING
    first = start_up_of(table)
    kept = table[first:]
    weight = kept[:, 1]
    lift = float(np.average(kept[:, 3], weights=weight))
    square = kept[:, 4] - 2 * lift * kept[:, 3] + lift**2
    drag, mean_square, pressure, length = (_interval(x) for x in (kept[:, 2], square, kept[:, 5], kept[:, 1]))
    parts = {"cd": drag, "cl_rms": _root(mean_square), "cp_base": pressure}
    if shedding:
        parts["strouhal"] = _inverse(length)
    half = wanted({name: part.value for name, part in parts.items()}, accuracy)
    wide = {name: _at_least(part, RESOLVED * half[name]) for name, part in parts.items()}
    return Statistics(
        begin=float(kept[0, 0]),
        period=length.value if shedding else 0.0,
        periods=len(kept),
        cd=wide["cd"],
        cl_rms=wide["cl_rms"],
        frequency=wide.get("strouhal", NO_NUMBER),
        cp_base=wide["cp_base"],
        excess=max(max(part.high - part.value, part.value - part.low) / half[name] for name, part in wide.items()),
        verdict=_verdict(kept, square) if shedding else "broadband",
    )


def wanted(values: dict[str, float], accuracy: float) -> dict[str, float]:
    """The half-width asked of each quantity: ``accuracy`` of it.

    The lift's rms and the Strouhal number are asked half as sharply: from one period to the next they vary several
    times as much as the means (7 % against 1 % behind a rhombus at Re 16 500), and nothing downstream depends on them
    as directly; a small rms is measured against a tenth of Cd, a small base pressure against half the
    dynamic pressure, so that a quantity near zero does not keep the run going.
    """
    floor = {"cd": MIN_DRAG, "cl_rms": MIN_DRAG * abs(values["cd"]), "cp_base": MIN_PRESSURE}
    scale = {name: max(abs(value), floor.get(name, 0.0)) for name, value in values.items()}
    return {name: LOOSER[name] * accuracy * size for name, size in scale.items()}


def cycles(rows: Array) -> Array:
    """(m, 6): begin, length (s), mean Cd, mean Cl, mean Cl^2, mean base pressure of every whole shedding period.

    The lift's mean and rms, which decide what counts as a period, are those of the second half of the record: the push
    that starts the shedding is not among them.
    """
    if len(rows) < 8:
        return np.zeros((0, 6))
    late = rows[rows[:, 0] >= 0.5 * (rows[0, 0] + rows[-1, 0]), 2]
    return _means(rows, upward_crossings(rows[:, 0], rows[:, 2], late))


def _pieces(rows: Array) -> Array:
    """A wake without a rhythm, cut into equal PIECES."""
    return _means(rows, np.linspace(rows[0, 0], rows[-1, 0], PIECES + 1)) if len(rows) > 1 else np.zeros((0, 6))


def _means(rows: Array, cuts: Array) -> Array:
    """Mean of each signal between neighbouring ``cuts`` (s), by trapezoids on the steps of the run."""
    if len(cuts) < 2:
        return np.zeros((0, 6))
    time = rows[:, 0]
    signals = np.column_stack([rows[:, 1], rows[:, 2], rows[:, 2] ** 2, rows[:, 3]])
    steps = np.diff(time)[:, None]
    integral = np.vstack([np.zeros(4), np.cumsum(0.5 * steps * (signals[1:] + signals[:-1]), axis=0)])
    at = np.clip(np.searchsorted(time, cuts, side="right") - 1, 0, len(time) - 2)
    ahead = (cuts - time[at])[:, None]
    there = signals[at] + ahead / steps[at] * (signals[at + 1] - signals[at])
    until = integral[at] + 0.5 * ahead * (signals[at] + there)
    length = np.diff(cuts)
    return np.column_stack([cuts[:-1], length, np.diff(until, axis=0) / length[:, None]])


def start_up_of(table: Array) -> int:
    """How many leading rows of :func:`cycles` belong to the start-up: at most half, and never the last MIN_PERIODS."""
    count = len(table)
    half = count // 2
    last = 0
    for signal in (table[:, 1], table[:, 2], table[:, 4], table[:, 5]):
        late = signal[half:]
        last = max(last, int(np.argmax(np.abs(signal - late.mean()) <= late.std())))
    return max(min(int(np.ceil(MARGIN * min(last, half))), count - MIN_PERIODS), 0)


def _interval(values: Array) -> Number:
    """Mean of a sequence, one value a period, and its 95 % interval."""
    mean, count = float(values.mean()), len(values)
    off = values - mean
    square = float((off**2).sum())
    if square == 0:
        return Number(mean, mean, mean)
    seen = (off[1:] * off[:-1]).sum() / square + 1 / count  # its mean is less by that
    correlation = float(np.clip((count * seen + WEIGHT * USUAL) / (count + WEIGHT), SHARED, STRONGEST))
    spread = np.sqrt(square / (count - 1) / count * (1 + correlation) / (1 - correlation))
    half = OFTEN * student(count - 1) * spread + _drift(values)
    return Number(mean, float(mean - half), float(mean + half))


def _drift(values: Array) -> float:
    """What a drift may still change: nothing unless the slope over the batches is significant.

    From the means a, b, c of three thirds: a geometric approach, c - b = q (b - a), ends at c + (c - b) q/(1 - q); an
    approach that does not slow down counts with q = NO_SLOWING.
    """
    size = max(len(values) // BATCHES, 1)
    count = len(values) // size
    batches = values[len(values) - count * size :].reshape(count, size).mean(axis=1)
    order = np.arange(count) - 0.5 * (count - 1)
    slope = (order * batches).sum() / (order**2).sum()
    rest = batches - batches.mean() - slope * order
    error = np.sqrt((rest**2).sum() / (count - 2) / (order**2).sum())
    if abs(slope) <= DRIFTING * error:
        return 0.0
    a, b, c = (float(part.mean()) for part in np.array_split(values, 3))
    ratio = float(np.clip((c - b) / (b - a), 0.0, NO_SLOWING)) if b != a else NO_SLOWING
    return abs(c + (c - b) * ratio / (1 - ratio) - float(batches.mean()))


def _root(square: Number) -> Number:
    return Number(*(float(np.sqrt(max(x, 0.0))) for x in square))


def _inverse(length: Number) -> Number:
    """1/length; a lower end at or below zero (a few wild periods) counts as a tenth of the mean."""
    return Number(1 / length.value, 1 / length.high, 1 / max(length.low, SHORTEST * length.value))


def _at_least(part: Number, half: float) -> Number:
    return Number(part.value, min(part.low, part.value - half), max(part.high, part.value + half))


def _verdict(kept: Array, square: Array) -> str:
    """periodic when length, mean drag and lift's rms repeat from period to period (PERIODIC), else broadband."""
    drag = float(np.abs(kept[:, 2]).mean())
    lift = np.sqrt(np.maximum(square, 0.0))
    spread = {
        "length": kept[:, 1].std() / kept[:, 1].mean(),
        "drag": kept[:, 2].std() / max(drag, 1e-300),
        "lift": lift.std() / max(lift.mean(), FAINT * drag),
    }
    return "periodic" if all(spread[name] <= most for name, most in PERIODIC.items()) else "broadband"


def is_still(rows: Array, scale: float, *, swings: bool = False) -> bool:
    """Whether the wake has come to rest: over ten convective times (``scale``, s) drag and base pressure stay within
    0.1 % (of the dynamic pressure at least), lift within 1e-3 and shrinking.

    Where the body vibrates (``swings``) drag and pressure never rest: there the lift decides.
    """
    if rows[-1, 0] < REST_AFTER * scale:
        return False
    recent = rows[rows[:, 0] > rows[-1, 0] - REST * scale]
    half = len(recent) // 2
    shrinks = np.ptp(recent[half:, 2]) <= np.ptp(recent[:half, 2])
    drag = swings or np.ptp(recent[:, 1]) < RESTING * abs(recent[:, 1].mean())
    pressure = swings or np.ptp(recent[:, 3]) < RESTING * max(abs(float(recent[:, 3].mean())), 1.0)
    return bool(drag and pressure and np.ptp(recent[:, 2]) < RESTING and shrinks)


class Stopping:
    """Whether a growing record may end: every tenth of it (and two periods at least) it is looked at."""

    def __init__(self, accuracy: float) -> None:
        self.accuracy = accuracy
        self.next = 0.0

    def look(self, rows: Array) -> bool:
        """Look at the record so far; cheap between two looks."""
        now, first = float(rows[-1, 0]), float(rows[0, 0])
        if now < self.next:
            return False
        result = evaluate(rows, self.accuracy)
        self.next = now + max(LATER * (now - first), 2 * result.period)
        return bool(result) and result.stands
