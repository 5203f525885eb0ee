"""Force coefficients and base pressure against time, of a running or finished case."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .case import read_parameters

Array = NDArray[np.float64]
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
