"""What no airflow can be: limits on every solution, from mass, momentum and Bernoulli's equation.

They are wide: no sound solution comes near them, on whatever mesh; a solution beyond one is nonsense, though the
solver ended well. With V = the largest mean speed in a gap (:func:`gap_speed`), D the first body's projected width:

- **speed** at most SPEED_FACTOR V: 1.5 for a parabolic profile times 2 for the side of a cylinder in potential flow,
  and a third more for the vortices of a time-resolved wake.
- **pressure** at most the largest total pressure on the inlets + friction: the total pressure of steady air has its
  largest value on a boundary (it obeys a maximum principle); only friction, of order mu V / D, can raise it. In time
  it may exceed that by the unsteady part, and coarse cells add their error: 0.5 V^2 covers both. (An inlet of uniform
  speed near the body has more than the mean pressure in its middle, so that Cp on the front may exceed 1.)
- **suction**: p at least that, less SPEED_FACTOR^2 V^2, less friction, by Bernoulli's equation at the highest speed.
- **drag** between 0 and (DRAG_FACTOR V / U)^2 + friction for all bodies, on their summed widths: the front has at most
  the stagnation pressure, the rear at least that of the fastest air that leaves the body's edges (a flat plate in
  two-dimensional time-resolved computations reaches 3.5, the limit is 9).
- **friction** / (rho U^2 / 2), falling as 1 / Re: creeping flow about a body (40: Lamb's drag of a cylinder at Re 1 is
  about 13), the lubrication pressure of a gap (96 B^2 / (1 - B)^3 over the bodies' height, B the blocked share) and of
  the channel's own walls (24 L D / W^2); three times their sum.
- **force** of granules on the air, which adds at most a pressure F along a way through it: F on either side of a
  pressure, 2 F / rho to V^2, and F on all bodies' widths to the drag, on either side.
- **mass**: inflow less outflow below 1e-3 of the inflow.
- **turbulence**: the model's fields (k, omega, nut ...) not negative; k at most 2 V^2, the energy of air that consists
  of fluctuations alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FoamError
from ...core.files import read_json
from ...core.geometry import between_walls
from .airflow_result import AirflowResult
from .case import FlowSpec
from .momentum_source import SOURCE
from .programs import AirflowFailure, Cause
from .read import CaseFields, time_folders

Array = NDArray[np.float64]
LEAK = 1e-3  # inflow less outflow over inflow
SPEED_FACTOR = 4.0  # largest speed over V: 1.5 x 2 x 4/3, see above
DRAG_FACTOR = 3.0  # root of the largest drag coefficient where V = U: two and a half times what a flat plate reaches
TURBULENCE = 2.0  # k over V^2
UNSTEADY = 0.5  # of (V/U)^2: unsteady part of the stagnation pressure
# What friction adds to a pressure or drag coefficient, times Re (see above):
CREEPING = 40.0  # creeping flow about a body: three times Lamb's drag of a cylinder at Re 1
CHANNEL = 24.0  # plane Poiseuille flow: 12 mu U L / W^2 over rho U^2 / 2
GAP = 96.0  # the same in two gaps of half the free width each, at the mean speed there
MARGIN = 3.0  # on the sum. Chosen: no sound solution comes near the limit
MIN_GAP = 1e-3  # of the channel's width: what bodies leave free counts as no less
ROUNDING = 1e-9  # of a scale: what counts as zero


@dataclass(frozen=True)
class Check:
    """A number beside its limits."""

    name: str
    value: float
    low: float
    high: float

    @property
    def holds(self) -> bool:
        """Whether the value lies within its limits; False for NaN too."""
        return bool(self.low <= self.value <= self.high)

    @property
    def used(self) -> float:
        """Share of the limit that the value takes up: 0 in the middle, 1 on the limit."""
        middle = 0.0 if self.low <= 0.0 <= self.high else 0.5 * (self.low + self.high)
        limit = self.high if self.value > middle else self.low
        return abs(self.value - middle) / abs(limit - middle) if limit != middle else float(self.value != middle)

    def __str__(self) -> str:
        return f"{self.name} is {self.value:.4g}, and must lie between {self.low:.4g} and {self.high:.4g}"


def blockage(bodies: Sequence[Sequence[tuple[float, float]]], width: float) -> float:
    """Largest share of the channel's ``width`` (m) that bodies, (k, 2) outlines in m, take up at any height, or between
    those on one side wall and those on the other.
    """
    outlines = [np.asarray(body, dtype=float) for body in bodies]
    levels = np.unique(np.concatenate([outline[:, 1] for outline in outlines]))
    nudge = 1e-6 * float(np.ptp(levels))
    taken = [
        sum(_chord(outline, y) for outline in outlines) for level in levels for y in (level - nudge, level + nudge)
    ]
    return max(*taken, width - between_walls(outlines, width)) / width


def _chord(outline: Array, y: float) -> float:
    """Length of the horizontal line at ``y`` inside a polygon."""
    start, end = outline, np.roll(outline, -1, axis=0)
    crossed = (start[:, 1] < y) != (end[:, 1] < y)
    a, b = start[crossed], end[crossed]
    x = np.sort(a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
    return float((x[1::2] - x[::2]).sum())


def gap_speed(spec: FlowSpec, inflow: float = 0.0, fastest: float = 0.0, driven: float = 0.0) -> float:
    """V (m/s): the air's mean speed beside the bodies where they leave it least room, or the inlets' largest speed.

    ``inflow`` (m2/s) of all inlets together and ``fastest`` (m/s) on any of them, where the inlet's mean speed is not
    all there is; ``driven``: what a force adds to p / rho (m2/s2). A vibrating body's own speed comes on top.
    """
    share = blockage(spec.mesh.bodies, spec.mesh.width)
    of_body = 0.0 if spec.vibration is None else abs(spec.vibration.peak_speed)
    mean = max(spec.speed, inflow / spec.mesh.width, fastest) / max(1.0 - share, MIN_GAP)
    return float(np.hypot(mean, (2.0 * driven) ** 0.5)) + of_body


def of_granules(spec: FlowSpec, case: Path) -> float:
    """What the granules' force in a ``case`` may add to p / rho (m2/s2) along a way; 0 where the air feels none."""
    return float(read_json(case / SOURCE)["pressure"]) / spec.density if (case / SOURCE).exists() else 0.0


def friction(spec: FlowSpec) -> float:
    """What viscosity may add to a pressure or drag coefficient; falls as 1 / Re."""
    share = blockage(spec.mesh.bodies, spec.mesh.width)
    size, width = spec.mesh.projected_width, spec.mesh.width
    heights = sum(float(np.ptp([y for _, y in body])) for body in spec.mesh.bodies) / size
    gap = GAP * share**2 / max(1.0 - share, MIN_GAP) ** 3 * max(heights, 1.0)
    channel = CHANNEL * (spec.mesh.top - spec.mesh.bottom) * size / width**2
    return MARGIN * (CREEPING * len(spec.mesh.bodies) + gap + channel) / spec.reynolds


def check_finite(folder: Path) -> None:
    """Check that every number in the stored velocities and pressures is finite. Raises AirflowFailure."""
    fields = CaseFields(folder)
    try:
        for path in time_folders(folder):
            for name in ("U", "p"):
                fields.field(path, name)
    except FoamError as problem:
        if "not finite" not in str(problem):
            raise
        raise AirflowFailure(Cause.NOT_FINITE, str(problem), log=problem.log) from None


def _field_checks(spec: FlowSpec, fields: CaseFields, time: Path) -> Iterator[Check]:
    """Speed, pressure and turbulence of one time within their limits, pressures as coefficients."""
    plane, dynamic = fields.mesh.plane, 0.5 * spec.speed**2
    velocity, faces = fields.field(time, "U")
    inlets = plane.on(*(name for name in plane.patches if name.startswith("inlet")))
    into = -(faces[inlets] * plane.normals[inlets]).sum(axis=1)
    inflow = float((into * plane.lengths[inlets]).clip(0).sum()) * (2 if spec.mesh.half else 1)
    force = of_granules(spec, fields.case)
    scale = gap_speed(spec, inflow, float(into.max()), force)
    yield Check("largest speed (m/s)", float(np.linalg.norm(velocity, axis=1).max()), 0.0, SPEED_FACTOR * scale)
    pressure, at_faces = fields.field(time, "p")
    mean = float(np.average(at_faces[plane.on("inlet")], weights=plane.lengths[plane.on("inlet")]))
    head = float((at_faces[inlets] + 0.5 * (faces[inlets] ** 2).sum(axis=1)).max() - mean) / dynamic
    swing = 0.0 if spec.vibration is None else abs(spec.vibration.peak_speed) * spec.vibration.omega
    pushed = (force + swing * spec.mesh.projected_width) / dynamic  # also by air a width deep that the body accelerates
    highest = head + UNSTEADY * (scale / spec.speed) ** 2 + friction(spec) + pushed
    lowest = head - (SPEED_FACTOR * scale / spec.speed) ** 2 - friction(spec) - pushed
    yield Check("largest Cp", float(pressure.max() - mean) / dynamic, lowest, highest)
    yield Check("least Cp", float(pressure.min() - mean) / dynamic, lowest, highest)
    for field in spec.model.fields:
        values = fields.field(time, field.name)[0]
        most = TURBULENCE * scale**2 if field.is_energy else np.inf
        yield Check(f"least {field.name}", float(values.min()), -ROUNDING * abs(float(values.max())), np.inf)
        yield Check(f"largest {field.name}", float(values.max()), 0.0, most)


def is_sane(spec: FlowSpec, folder: Path, time: Path) -> bool:
    """Whether a stored time may be gone on from."""
    try:
        return all(check.holds for check in _field_checks(spec, CaseFields(folder), time))
    except FoamError:  # not finite, or cut short: no state to go on from
        return False


def check_airflow(spec: FlowSpec, folder: Path, result: AirflowResult) -> list[Check]:
    """Fields of the latest time and measured numbers within their limits. Raises AirflowFailure naming those beyond,
    and the limit.
    """
    fields = CaseFields(folder)
    checks = list(_field_checks(spec, fields, fields.folder("latest")))
    force, rubbing = of_granules(spec, folder), friction(spec)
    scale, pushed = gap_speed(spec, driven=force) / spec.speed, force / (0.5 * spec.speed**2)
    widths = sum(float(np.ptp([x for x, _ in body])) for body in spec.mesh.bodies) / spec.mesh.projected_width
    pressure = next(check for check in checks if check.name == "least Cp")
    checks += [
        Check("the mass lost between inlets and outlet, of the inflow,", result.mass_error, -LEAK, LEAK),
        Check(
            "the drag coefficient",
            result.cd.value,
            min(0.0, -widths * pushed),
            widths * ((DRAG_FACTOR * scale) ** 2 + pushed) + rubbing,
        ),
        Check("Cp on the front", result.cp_front, pressure.low, pressure.high),
        Check("Cp on the rear", result.cp_base.value, pressure.low, pressure.high),
    ]
    broken = [str(check) for check in checks if not check.holds]
    if broken:
        raise AirflowFailure(Cause.NONSENSE, f"the airflow is not possible: {'; '.join(broken)}")
    return checks
