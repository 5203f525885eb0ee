"""What a solved case cost, by its solvers' own logs."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["core_seconds"]

ENTRY = re.compile(r"^(nProcs|ExecutionTime) *[:=] *([0-9.e+]+)", re.M)


def core_seconds(case: Path) -> float:
    """Processor seconds (all ranks) that the solvers spent in ``case``, restarts and failed attempts counted.

    OpenFOAM prints ``nProcs`` when it starts and its ExecutionTime, processor time since then, after every step. Unlike
    wall seconds it does not grow when other programs share the machine.
    """
    total = 0.0
    for log in sorted([*case.glob("log.[sp]imple*"), *case.glob("failed-*.log")]):
        ranks, last = 1, 0.0
        for name, value in ENTRY.findall(log.read_text(errors="replace")):
            if name == "nProcs":
                total, last, ranks = total + ranks * last, 0.0, int(value)
            else:
                last = float(value)
        total += ranks * last
    return total
