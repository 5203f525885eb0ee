"""The numbers of one airflow, as its solver's stage keeps them in airflow.json."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .failure import Attempt
from .history import Interval
from .suction import Suction

__all__ = ["AirflowResult"]


@dataclass(frozen=True)
class AirflowResult:
    """Measured airflow. Coefficients use the inlet's mean speed and, for Cd and Cl, the first body's projected width;
    with several bodies Cd and Cl are of all of them together, and ``cd_of`` holds each one's share of Cd by name.

    Cp = (p - mean p on the inlet) / (rho U^2 / 2), p static: OpenFOAM's without 2k/3, k being 0 at no-slip walls.
    ``cp_base`` and ``cp_front`` are taken where the vertical line through the middle of the first body meets its rear
    and its front. ``p_inlet`` (Pa): mean static p on the inlet; ``pressure_drop`` (Pa): that less the mean on the
    outlet. ``flow_rate`` (m2/s, per metre of depth, whole channel); ``mass_error``: inflow less outflow over inflow.
    ``strouhal`` = f D / U, None when steady. ``field_time`` is the ``time`` to give to ``read_flow`` for tracking
    ("states": one of ``late_states`` after the other). ``loop_mismatch``: rms velocity difference between the snapshots
    at the join of the loop over the rms fluctuation. ``motion``: of the mesh, where the body vibrates in the air:
    amplitude (x, y) m, omega (rad/s), phase (rad) at the loop's start; the stored field belongs to positions less
    amplitude sin(omega t + phase). ``seconds`` of wall time. ``settings`` that served and the ``attempts`` that failed
    before, see :mod:`wakeflow.foam.ladder`; ``checks``: share of each limit of :mod:`wakeflow.foam.sanity` that is
    taken up; ``span``: of an airflow in three dimensions, see :mod:`wakeflow.foam.span_measure`.

    Intervals: of a steady run the range over its last iterations, of one that did not settle over those of its late
    states; of a time-resolved one 95 % intervals of the long-time mean (:mod:`wakeflow.foam.statistics`).
    ``statistics`` of a time-resolved run: whole ``periods`` averaged, ``start_up`` (s) dropped, ``accuracy`` asked,
    ``excess`` (largest half-width over the one asked). ``notes``: what a reader must know.

    Cd is OpenFOAM's forceCoeffs. Its pressure part uses OpenFOAM's p, which is right: at a wall k = 0, and p there is
    the static pressure (p, static pressure plus normal stress 2k/3, does not change across the layer beside it).
    """

    stepping: str
    verdict: str
    turbulence: str
    cells: int
    reynolds: float
    cd: Interval
    cl_rms: Interval
    strouhal: Interval | None
    cp_base: Interval
    cp_front: float
    p_inlet: float
    pressure_drop: float
    flow_rate: float
    mass_error: float
    suction: Suction
    y_plus: tuple[float, float]
    steps: int
    seconds: float
    field_time: str
    period: float | None = None
    motion: dict[str, Any] | None = None
    loop_mismatch: float | None = None
    residuals: dict[str, float] = field(default_factory=dict)
    mesh: dict[str, float] = field(default_factory=dict)
    statistics: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    cd_of: dict[str, float] = field(default_factory=dict)
    settings: str = "normal"
    attempts: tuple[Attempt, ...] = ()
    checks: dict[str, float] = field(default_factory=dict)
    span: dict[str, Any] | None = None
