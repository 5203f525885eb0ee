"""Force coefficients against time, of a running or finished case, and what they say about shedding."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["Interval", "Tail", "batch_interval", "is_settled", "kind_of", "read_table", "upward_crossings"]

Array = NDArray[np.float64]
CD, CL = 1, 3  # columns of coefficient.dat in OpenFOAM 1912: Time Cd Cs Cl ...


@dataclass(frozen=True)
class Interval:
    """A measured number with its 95 % interval."""

    value: float
    low: float
    high: float


def read_table(case: Path, what: str, columns: tuple[int, ...]) -> Array:
    """Rows (n, 1 + c) of time and ``columns`` of ``postProcessing/WHAT/*/*.dat``, each restart replacing what it
    computed again.
    """
    rows = np.zeros((0, 1 + len(columns)))
    folder = case / "postProcessing" / what
    starts = sorted(folder.iterdir(), key=lambda path: float(path.name)) if folder.is_dir() else []
    for start in starts:
        for path in sorted(start.glob("*.dat"), key=lambda p: p.stat().st_mtime):
            new = np.array([[float(line[i]) for i in (0, *columns)] for line in _lines(path, max(columns))])
            if len(new):
                rows = np.vstack([rows[rows[:, 0] < new[0, 0]], new])
    return rows


def _lines(path: Path, last: int) -> list[list[str]]:
    words = [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [line for line in words if len(line) > last]


class Tail:
    """Rows (time, Cd, Cl) of a growing coefficient history: what is there, then what each :meth:`update` finds."""

    def __init__(self, case: Path) -> None:
        self.case = case
        self.rows = read_table(case, "forceCoefficients", (CD, CL)).tolist()
        self.known = {path: path.stat().st_mtime_ns for path in self._files()}
        self.path: Path | None = None
        self.at = 0

    def _files(self) -> list[Path]:
        return list((self.case / "postProcessing" / "forceCoefficients").glob("*/*.dat"))

    def update(self) -> Array:
        """All rows (n, 3) so far."""
        if self.path is None:
            growing = (path for path in self._files() if path.stat().st_mtime_ns != self.known.get(path))
            self.path = next(growing, None)
        if self.path is not None:
            with self.path.open("rb") as stream:
                stream.seek(self.at)
                text = stream.read()
            text = text[: text.rfind(b"\n") + 1]
            self.at += len(text)
            for line in text.decode().splitlines():
                words = line.split()
                if line.startswith("#") or len(words) <= CL:
                    continue
                row = [float(words[0]), float(words[CD]), float(words[CL])]
                while self.rows and self.rows[-1][0] >= row[0]:
                    self.rows.pop()
                self.rows.append(row)
        return np.array(self.rows).reshape(-1, 3)


def upward_crossings(time: Array, signal: Array) -> Array:
    """Times at which ``signal`` rises through its mean, to second order; wiggles below half its rms do not count."""
    deviation = signal - signal.mean()
    level = 0.5 * float(np.sqrt(np.mean(deviation**2)))
    if level == 0:
        return np.zeros(0)
    times, armed = [], False
    last = None
    for i in range(1, len(deviation)):
        if deviation[i - 1] < -level:
            armed, last = True, None
        if armed and deviation[i - 1] <= 0 < deviation[i]:
            last = time[i - 1] - deviation[i - 1] * (time[i] - time[i - 1]) / (deviation[i] - deviation[i - 1])
        if armed and last is not None and deviation[i] > level:
            times.append(float(last))
            armed = False
    return np.array(times)


def is_settled(rows: Array, cycles: int = 3) -> float | None:
    """The shedding period (s) once the last ``cycles`` cycles of lift repeat: lengths and mean drag within 2 %, lift
    rms within 5 %.

    ``rows`` (n, 3): time, Cd, Cl. None while they do not.
    """
    recent = rows[rows[:, 0] > rows[-1, 0] - 0.6 * (rows[-1, 0] - rows[0, 0])]
    crossings = upward_crossings(recent[:, 0], recent[:, 2])[-(cycles + 1) :]
    if len(crossings) < cycles + 1:
        return None
    lengths = np.diff(crossings)
    parts = [rows[(rows[:, 0] >= a) & (rows[:, 0] < b)] for a, b in pairwise(crossings)]
    drag = np.array([part[:, 1].mean() for part in parts])
    lift = np.array([part[:, 2].std() for part in parts])
    if np.ptp(lengths) > 0.02 * lengths.mean() or np.ptp(drag) > 0.02 * abs(drag.mean()):
        return None
    return float(lengths.mean()) if np.ptp(lift) <= 0.05 * lift.mean() and lift.mean() > 1e-3 else None


def batch_interval(parts: list[float] | Array) -> Interval:
    """Mean of batches and its 95 % interval by Student's t (batches are whole periods: nearly independent)."""
    values = np.asarray(parts, dtype=float)
    mean = float(values.mean())
    if len(values) < 2:
        return Interval(mean, mean, mean)
    from scipy.stats import t

    half = float(t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))
    return Interval(mean, mean - half, mean + half)


def kind_of(signal: Array, tolerance: float) -> str:
    """steady | periodic | broadband: range within ``tolerance`` of the mean; autocorrelation above 0.5 again;
    neither.
    """
    mean = float(signal.mean())
    if np.ptp(signal) <= tolerance * max(abs(mean), 1e-12):
        return "steady"
    deviation = signal - mean
    spectrum = np.fft.rfft(deviation, 2 * len(deviation))
    lagged = np.fft.irfft(np.abs(spectrum) ** 2)[: len(deviation) // 2]
    lagged = lagged / lagged[0] * len(deviation) / (len(deviation) - np.arange(len(lagged)))
    negative = np.flatnonzero(lagged < 0)
    again = lagged[negative[0] :].max() if len(negative) else 0.0
    return "periodic" if again > 0.5 else "broadband"
