"""Compare the tracker of this checkout with that of another one: flights that must agree bit by bit, and their times.

Each checkout gets a child process of its own (PYTHONPATH), which compiles its kernel first. Then both fly the flights
of compared_flights.py in turn, and the order changes from pair to pair. The table gives for each flight the median of
the ratios of processor time (here / other) with the quartiles, and the command fails when one number of one track
differs. A busy machine disturbs both flights of a pair alike, so that medians of many short pairs hold.
kernel_speed OTHER/src --pairs 30
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from support import ROOT

from .common import Row, show

SAME = {"flight": "{flight}", "steps": "{steps:.1f}", "impacts": "{impacts:.2f}", "tracks": "{verdict}"}
TIMES = {
    "flight": "{flight}", "other, ms": "{spent:.1f*1e3}", "ratio": "{quartiles[1]:.3f}",
    "quartiles": "{quartiles[0]:.3f} to {quartiles[2]:.3f}",
}  # fmt: skip


class Checkout:
    """A checkout's child process."""

    def __init__(self, source: Path) -> None:
        self.source = source.resolve()
        threads = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("compared_flights.py")], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(self.source), **threads},
        )  # fmt: skip

    def answer(self) -> Any:
        """What the child says next."""
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"{self.source}: the child ended")
        return json.loads(line)

    def ask(self, name: str, save: Path | None = None) -> None:
        """Let it fly; its answer will be the processor time (s)."""
        self.process.stdin.write(json.dumps({"name": name, "save": None if save is None else str(save)}) + "\n")
        self.process.stdin.flush()

    def fly(self, name: str, save: Path | None = None) -> float:
        """The processor time (s) of a flight."""
        self.ask(name, save)
        return float(self.answer())


Pair = tuple[Checkout, Checkout]


@contextmanager
def checkouts(here: Path, other: Path) -> Iterator[Pair]:
    """Both children."""
    pair = Checkout(here), Checkout(other)
    try:
        yield pair
    finally:
        for one in pair:
            one.process.kill()
            one.process.wait()


def differences(one: Path, other: Path) -> list[str]:
    """Names of the columns that are not equal, bit by bit, NaN where NaN."""
    with np.load(one) as a, np.load(other) as b:
        return sorted(
            name
            for name in set(a.files) | set(b.files)
            if name not in a or name not in b or not np.array_equal(a[name], b[name], equal_nan=True)
        )


def compared(pair: Pair, names: Sequence[str]) -> Iterator[Row]:
    """Fly all flights once in both, and say which differ."""
    for one in pair:  # both compile at once
        one.ask(names[0])
    for one in pair:
        one.answer()
    with TemporaryDirectory() as folder:
        for name in names:
            places = Path(folder, "here.npz"), Path(folder, "other.npz")
            for one, place in zip(pair, places, strict=True):
                one.fly(name, place)
            differing = differences(*places)
            with np.load(places[0]) as tracks:
                steps, impacts = tracks["steps"].mean(), tracks["impacts"].mean()
            verdict = f"DIFFERS: {', '.join(differing)}" if differing else "identical"
            yield {"flight": name, "steps": steps, "impacts": impacts, "verdict": verdict, "differs": bool(differing)}


def timed(pair: Pair, name: str, pairs: int) -> Row:
    """Ratios of processor times (here / other), and the time (s) of the other."""
    spent = np.array([[one.fly(name) for one in pair[:: 1 - number % 2 * 2]] for number in range(pairs)])
    spent[1::2] = spent[1::2, ::-1]
    ratios = spent[:, 0] / spent[:, 1]
    quartiles = np.quantile(ratios, [0.25, 0.5, 0.75])
    return {"flight": name, "spent": np.median(spent[:, 1]), "quartiles": quartiles, "ratios": ratios}


def main(against: Path, *, here: Path = ROOT / "src", pairs: int = 30, only: str = "") -> None:
    """This checkout's tracker and that of another (its folder src), bit by bit and by time; --pairs 0: bits alone."""
    with checkouts(here, against) as both:
        names, _ = ([name for name in one.answer() if only in name] for one in both)
        bad = sum(row["differs"] for row in show(SAME, compared(both, names)))
        print(f"{len(names) - bad} of {len(names)} flights are identical, bit by bit")
        if pairs:
            found = show(TIMES, (timed(both, name, pairs) for name in names), "times")
            medians = np.array([row["quartiles"][1] for row in found])
            low, middle, high = np.quantile(np.concatenate([row["ratios"] for row in found]), [0.25, 0.5, 0.75])
            print(
                f"all: median ratio {middle:.3f}, quartiles {low:.3f} to {high:.3f}; medians of the flights "
                f"{medians.min():.3f} to {medians.max():.3f}, their geometric mean {np.exp(np.log(medians).mean()):.3f}"
            )
    raise SystemExit(1 if bad else 0)
