"""LIGGGHTS, the granular engine: its version, the funnel's walls, its input and output, the discharge rate.

The outlet's edge lies at z = 0, z points up; the cone widens to a straight part that keeps jumping beads inside.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ProgramError
from ...core.files import atomic_write
from ...core.number import NO_NUMBER, Number
from ...core.process import capture, run_program, tail, unheard
from ...scene import Funnel

# -- LIGGGHTS, the granular engine -------------------------------------------------------------------------------------
Array = NDArray[np.float64]
PROGRAM = "liggghts"
INSTALL = "apt-get install --no-install-recommends liggghts"
SCRIPTS = Path(__file__).parent


@cache
def liggghts_version() -> str:
    """Version of the installed LIGGGHTS, "3.8.0". Raises ProgramError when there is none."""
    where = shutil.which(PROGRAM)
    if where is None:
        raise ProgramError(f"LIGGGHTS is needed: {INSTALL}", command=PROGRAM, ended="missing")
    _, text = capture([where, "-log", "none", "-help"])  # ends with code 1 after its help
    match = re.search(r"Version LIGGGHTS-PUBLIC ([\d.]+)", text)
    if match is None:
        raise ProgramError(f"{PROGRAM} does not start; {INSTALL}", command=f"{PROGRAM} -help", tail=text[-500:])
    return match[1]


def write_settings(folder: Path, values: Mapping[str, float | int | str]) -> None:
    """Write the variables of a script, ``settings.liggghts``."""
    with atomic_write(folder / "settings.liggghts") as stream:
        for name, value in values.items():
            text = f"{value:.12g}" if isinstance(value, float) else value
            stream.write(f"variable {name} string {text}\n")


def write_beads(folder: Path, centres: Array, diameters: Array, velocities: Array, density: float, box: Array) -> None:
    """Write ``beads.data``: centres (n, 3) m, diameters (n,) m, velocities (n, 3) m/s, in a ``box`` (3, 2) m."""
    with atomic_write(folder / "beads.data") as stream:
        stream.write(f"beads at rest or poured\n\n{len(centres)} atoms\n2 atom types\n\n")
        for axis, (low, high) in zip("xyz", box, strict=True):
            stream.write(f"{low:.9g} {high:.9g} {axis}lo {axis}hi\n")
        stream.write("\nAtoms\n\n")
        for i, (diameter, (x, y, z)) in enumerate(zip(diameters, centres, strict=True), 1):
            stream.write(f"{i} 1 {diameter:.12g} {density:.12g} {x:.12g} {y:.12g} {z:.12g}\n")
        stream.write("\nVelocities\n\n")
        for i, (u, v, w) in enumerate(velocities, 1):
            stream.write(f"{i} {u:.9g} {v:.9g} {w:.9g} 0 0 0\n")


def run_script(folder: Path, script: Path, on_line: Callable[[str], None] = unheard) -> None:
    """Run ``script`` in ``folder``, beside its settings, beads and walls; log.NAME there holds what it says.

    The scripts are copied, so that the folder can be run again by hand. Raises ProgramError, with LIGGGHTS' own words.
    """
    for file in (script, SCRIPTS / "beads.liggghts"):
        shutil.copyfile(file, folder / file.name)
    name = script.stem
    log = folder / f"log.{name}"
    # line by line: where MPI aborts it the text in its buffer is lost, and that holds the reason
    command = ["stdbuf", "-oL", PROGRAM, "-in", f"{name}.liggghts", "-log", "none", "-echo", "none"]
    try:
        run_program(command, cwd=folder, log=log, on_line=on_line, hint=INSTALL)
    except ProgramError as problem:
        said = re.findall(r"\bERROR\b.*", tail(log, 40))
        if problem.ended == "failed" and said:
            raise ProgramError(
                f"{PROGRAM}: {said[-1]}; log: {log}", command=" ".join(command), log=log, tail=tail(log), ended="failed"
            ) from None
        raise


def read_dump(path: Path) -> list[tuple[int, Array]]:
    """Snapshots of five columns, id first: step and rows (n, 5), sorted by id; an unfinished last one is left out.

    Those of the funnel are id, radius, x, y, z (m).
    """
    lines = path.read_text().splitlines()
    snapshots, at = [], 0
    while at + 9 <= len(lines):
        step, count = int(lines[at + 1]), int(lines[at + 3])
        rows = lines[at + 9 : at + 9 + count]
        if len(rows) < count:
            break
        table = np.array([row.split() for row in rows], dtype=float).reshape(count, 5)
        snapshots.append((step, table[np.argsort(table[:, 0])]))
        at += 9 + count
    return snapshots


# -- The funnel's walls as triangles -----------------------------------------------------------------------------------
SIDES = 36  # of the polygon that represents the circle, of equal area
SPACING = 1.03  # largest diameters between the beads of the loose heap
BRIM_SPEED_RATIO = 2.5  # times the wall's peak speed: beads thrown higher than that leave over the brim


@dataclass(frozen=True)
class Cone:
    """Inner radius (m) ``outlet`` at z = 0, growing by ``slope`` up to ``top``, straight from there to ``brim`` (m)."""

    outlet: float
    slope: float
    top: float
    brim: float

    def radius(self, z: Array | float) -> Array:
        """Inner radius (m) at heights ``z`` (m) above the outlet."""
        return self.outlet + self.slope * np.clip(z, 0.0, self.top)

    def room(self, centres: Array) -> Array:
        """Distance (n,) m of points (n, 3) m from the wall, positive inside; of points above the outlet."""
        across, z = np.hypot(centres[:, 0], centres[:, 1]), centres[:, 2]
        slanted = (self.outlet + self.slope * z - across) / math.hypot(1.0, self.slope)
        return np.minimum(slanted, self.widest - across)

    @property
    def widest(self) -> float:
        """Inner radius (m) of the straight part."""
        return self.outlet + self.slope * self.top


def _layers(funnel: Funnel) -> tuple[Array, float]:
    """Bead centres (n, 3) on a cubic lattice in the funnel, and the height (m) of the uppermost."""
    step, reach = SPACING * funnel.high, 0.5 * funnel.high / math.cos(funnel.half_angle)
    slope, widest = math.tan(funnel.half_angle), funnel.width / 2 if funnel.width else math.inf
    layers: list[Array] = []
    layer = count = 0
    while count < funnel.beads:
        z = (layer + 0.6) * step
        room = min(funnel.orifice / 2 + slope * (z - 0.5 * step), widest) - reach
        line = step * (np.arange(-math.ceil(room / step) - 1, math.ceil(room / step) + 2) + 0.5 * (layer % 2))
        x, y = np.meshgrid(line, line)
        inside = np.hypot(x, y) <= room
        layers.append(np.stack([x[inside], y[inside], np.full(int(inside.sum()), z)], axis=1))
        count, layer = count + int(inside.sum()), layer + 1
    return np.concatenate(layers)[: funnel.beads], z


def cone_of(funnel: Funnel) -> Cone:
    """The funnel's inner wall, high enough for the loose heap and for the beads that the vibration throws up."""
    _, fill = _layers(funnel)
    slope = math.tan(funnel.half_angle)
    top = (funnel.width - funnel.orifice) / (2 * slope) if funnel.width else fill + funnel.high
    peak = BRIM_SPEED_RATIO * funnel.amplitude * 2 * math.pi * funnel.shaken_at
    brim = max(top, fill) + 5 * funnel.high + 2 * funnel.amplitude + peak**2 / (2 * funnel.gravity)
    return Cone(funnel.orifice / 2, slope, top, brim)


def loose_heap(funnel: Funnel) -> tuple[Array, Array, Array]:
    """Centres (n, 3) m, diameters (n,) m and velocities (n, 3) m/s of beads that do not touch, ready to be poured.

    Diameters are uniform between low and high; velocities are small and random, so that no trace of the lattice is
    left.
    """
    random = np.random.default_rng(funnel.seed)
    centres, _ = _layers(funnel)
    diameters = random.uniform(funnel.low, funnel.high, len(centres))
    return centres, diameters, random.normal(0.0, 0.1, centres.shape)


def write_stl(folder: Path, cone: Cone) -> None:
    """Write ``cone.stl`` and ``lid.stl``, the disc that closes the outlet."""
    angle = 2 * math.pi * np.arange(SIDES) / SIDES
    swell = math.sqrt(2 * math.pi / (SIDES * math.sin(2 * math.pi / SIDES)))  # polygon and circle of equal area
    circle = swell * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = [_ring(circle, float(cone.radius(z)), z) for z in _heights(cone)]
    wall = [triangle for low, high in pairwise(rings) for triangle in _band(low, high)]
    write_triangles(folder / "cone.stl", "cone", wall)
    edge, middle = rings[0], np.zeros(3)
    lid = [np.stack([middle, edge[i], edge[(i + 1) % SIDES]]) for i in range(SIDES)]
    write_triangles(folder / "lid.stl", "lid", lid)


def _heights(cone: Cone) -> list[float]:
    """Where the wall's rings lie: triangles at most eight times as long as their base."""
    heights = [0.0]
    while heights[-1] < cone.brim:
        z = heights[-1] + 8 * 2 * math.pi * float(cone.radius(heights[-1])) / SIDES
        z = cone.top if heights[-1] < cone.top < z + 1e-3 * cone.top else z
        heights.append(cone.brim if z > 0.95 * cone.brim else z)
    return heights


def _ring(circle: Array, radius: float, z: float) -> Array:
    return np.column_stack([radius * circle, np.full(len(circle), z)])


def _band(low: Array, high: Array) -> list[Array]:
    """Triangles (3, 3) between two rings."""
    made = []
    for i in range(SIDES):
        j = (i + 1) % SIDES
        made += [np.stack([low[i], low[j], high[j]]), np.stack([low[i], high[j], high[i]])]
    return made


def write_triangles(path: Path, name: str, triangles: list[Array]) -> None:
    """Write triangles (3, 3), corners in m, as a solid ``name`` of an STL file."""
    with atomic_write(path) as stream:
        stream.write(f"solid {name}\n")
        for corners in triangles:
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            normal /= np.linalg.norm(normal)
            stream.write("facet normal {:.9g} {:.9g} {:.9g}\nouter loop\n".format(*normal))
            stream.writelines("vertex {:.9g} {:.9g} {:.9g}\n".format(*corner) for corner in corners)
            stream.write("endloop\nendfacet\n")
        stream.write(f"endsolid {name}\n")


STEADY = (0.10, 0.75)  # shares of the mass discharged: between them the funnel neither starts nor runs empty
BATCHES = 8  # parts of the steady stretch whose rates give the interval
MIN_PARTS = 4  # parts below which no interval is given
EMPTY = 0.99  # share of the mass discharged at which the funnel counts as empty, since single beads may stay


@dataclass(frozen=True)
class Curve:
    """Time (k,) s since the outlet was opened, mass (k,) kg and beads (k,) that are still above the outlet."""

    time: Array
    mass: Array
    beads: Array


def read_curve(path: str, opened: float) -> Curve:
    """The curve that discharge.liggghts printed; ``opened`` (s) is when the lid went."""
    rows = np.loadtxt((line for line in path.splitlines() if line.startswith("curve ")), usecols=(1, 2, 3), ndmin=2)
    return Curve(rows[:, 0] - opened, rows[:, 1], rows[:, 2])


def time_to_empty(curve: Curve, total: float) -> float:
    """Time (s) at which the share :data:`EMPTY` of the ``total`` mass (kg) was out; no number when it never was."""
    out = curve.mass <= (1 - EMPTY) * total
    return float(curve.time[np.argmax(out)]) if out.any() else math.nan


def rate_of(curve: Curve, total: float, period: float) -> Number:
    """The rate between :data:`STEADY` shares of the ``total`` mass (kg); none where the flow stopped before.

    The stretch is cut to whole periods (s) of the vibration, 0 at rest, and into up to :data:`BATCHES` parts of whole
    periods; the interval is Student's from the parts' rates, taken as independent. It is the scatter within one
    discharge: another pouring may differ by more.
    """
    gone = 1 - curve.mass / total
    if gone.max() < STEADY[1]:
        return NO_NUMBER
    start, end = (float(curve.time[np.argmax(gone >= share)]) for share in STEADY)
    length = end - start
    whole = 1
    if period and length >= period:
        whole = math.floor(length / period)
        length = whole * period
    parts = BATCHES if not period or end - start < period else min(BATCHES, whole)
    if period and parts < BATCHES and whole < MIN_PARTS:
        parts = 1
    edges = start + length * np.arange(parts + 1) / parts
    if period and parts > 1:  # parts of whole periods, some a period longer than others
        edges = start + period * np.round(whole * np.arange(parts + 1) / parts)
    mass = np.interp(edges, curve.time, curve.mass)
    return _student(-np.diff(mass), np.diff(edges))


def _student(mass: Array, time: Array) -> Number:
    """Total over total time, with Student's interval of the parts' rates weighted by their time."""
    value = float(mass.sum() / time.sum())
    count = len(mass)
    if count < MIN_PARTS:
        return Number(value)
    from scipy.stats import t

    spread = math.sqrt(float((time / time.mean() * (mass / time - value) ** 2).sum()) / (count - 1))
    half = float(t.ppf(0.975, count - 1)) * spread / math.sqrt(count)
    return Number(value, value - half, value + half)
