"""Levels of airflow fidelity: what each computes, where it is the truth, and which one a scene needs.

draft: one steady solution. Below the onset of vortex shedding it is the flow itself; above, its wake is too long and
its suction too weak. standard: time-resolved in two dimensions, started from the draft. Up to the onset of
three-dimensional motion it is the flow itself; above, it sheds too coherently and its suction is too strong, so that
draft and standard bracket the truth. reference: the same on three grids, which gives the error of the mesh. none: no
air at all; where a scene has some, what that leaves out is stated. Without a body the air is known (analytic).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..core.errors import SceneError
from ..core.geometry import is_symmetric
from ..core.registry import did_you_mean
from ..laws.turbulence_models import model_at, turbulence_models
from ..scene import Scene
from ..scene.user_case import is_laminar

__all__ = [
    "FLAT_BELOW",
    "LAMINAR_BELOW",
    "SHEDDING_ABOVE",
    "AirflowPlan",
    "choose_airflow",
    "ranks_for",
    "typical_cells",
    "typical_seconds",
]

Stepping = Literal["steady", "time-resolved"]
RUNGS = ("auto", "none", "draft", "standard", "reference")
# Reynolds numbers on the body's width and the inlet's mean speed.
SHEDDING_ABOVE = 27.7  # a flat plate's onset, the lowest (triangle 34.3, circle 46.2: Jackson 1987, J. Fluid Mech. 182)
# walls raise it (36, 60, 91 at blockages of 1/8, 1/4, 1/2: Parveez, Dhiman & Rasool 2014, a trapezoidal prism)
FLAT_BELOW = 160.0  # two-dimensional below: mode A of a square's wake at 161 (Robichaux 1999), of a circle's near 190
LAMINAR_BELOW = turbulence_models["laminar"].reynolds[1]  # above it a turbulence model runs
FINE = 0.005  # accuracy of a share that pays for three grids where the mesh is what limits it
GRIDS = 1.5  # refinement ratio between the grids of a study
# of the airflow's statistics: below a third of what grids differ by; as usual; where model errors are tens of per cent
ACCURACY = {"reference": 0.005, "flat": 0.02, "bracket": 0.05}
SECONDS = {"steady": 15.0, "time-resolved": 90.0}  # of solving on 2020s hardware at the rung's own mesh, one core
WORTH_IT = 60_000  # cells from which a second MPI rank pays; each gets half of it at least
CELLS = {"steady": 5000.0, "time-resolved": 8000.0}  # typical, a body


@dataclass(frozen=True)
class AirflowPlan:
    """How the airflow is computed: ``rung``, ``why`` it was chosen, how it steps, its turbulence model.

    ``symmetric``: the geometry is its own mirror image about x = 0; ``half``: only half of the channel is solved, the
    other half is its mirror image. ``scales``: cell edges over the rung's own, one a grid, the first is the answer's.
    ``accuracy``: relative half width of the 95 % intervals of drag, base pressure and shedding frequency at which a
    time-resolved run may end. ``moving``: the mesh vibrates with the bodies; else the air sees them at rest.
    ``brackets``: steady and time-resolved solutions are two ends between which the truth lies, and both are flown in.
    """

    rung: str  # none | analytic (nothing stands in it) | draft | standard | reference | given (a case of the user's)
    why: str
    stepping: Stepping | None
    turbulence: str | None  # one of laws.turbulence_models, "decaying" (analytic air), "given" (a case of the user's)
    symmetric: bool
    half: bool
    scales: tuple[float, ...] = (1.0,)
    brackets: bool = False
    moving: bool = False
    accuracy: float = 0.02

    @property
    def turbulent(self) -> bool:
        """Whether the wake is turbulent: by the model that runs, or in a user's case that brings k."""
        solved = self.turbulence in turbulence_models and turbulence_models[str(self.turbulence)].turbulent
        return solved or self.turbulence == "given"

    @property
    def mirrored(self) -> bool:
        """Whether half of the granules fly in the airflow's mirror image: it is as likely where nothing tells left
        from right, and a wake, computed whole, may lean.
        """
        return self.stepping is not None and self.symmetric and not self.half


def choose_airflow(scene: Scene, asked: str, target_error: float) -> AirflowPlan:
    """The airflow of a rung asked for; ``auto`` goes by Reynolds number and the accuracy asked for (a share).

    Raises SceneError for a rung that the scene cannot have.
    """
    if asked not in RUNGS:
        raise SceneError(f"rung = {asked!r}: unknown{did_you_mean(asked, list(RUNGS))} (known: {', '.join(RUNGS)})")
    symmetric = scene.symmetric
    if scene.air is None:
        if asked not in ("auto", "none"):
            raise SceneError(f"rung = {asked!r} needs an [air] table; leave the rung out for a vacuum")
        return AirflowPlan("none", "there is no [air]", None, None, symmetric, half=False)
    if asked == "none":
        if not scene.body:
            raise SceneError("rung = 'none' leaves the air out, and without a body nothing is left: choose auto")
        return AirflowPlan("none", "asked for: the air is left out", None, None, symmetric, half=False)
    if not scene.body:
        return _analytic(scene, asked)
    if scene.air.case is not None:
        return _given(scene.air.case, asked)
    reynolds = scene.reynolds
    assert reynolds is not None
    rung, why = (asked, "asked for") if asked != "auto" else _auto(reynolds, target_error)
    sheds = reynolds >= SHEDDING_ABOVE
    steady = rung == "draft" or (rung == "reference" and not sheds)
    return AirflowPlan(
        rung=rung,
        why=why,
        stepping="steady" if steady else "time-resolved",
        turbulence=model_at(reynolds).name,
        symmetric=symmetric,
        half=steady and symmetric and all(is_symmetric(body.outline()) for body in scene.body.values()),
        scales=(1 / GRIDS, 1.0, GRIDS) if rung == "reference" else (1.0,),
        brackets=not steady and reynolds > FLAT_BELOW,
        accuracy=ACCURACY["reference" if rung == "reference" else "bracket" if reynolds > FLAT_BELOW else "flat"],
    )


def _analytic(scene: Scene, asked: str) -> AirflowPlan:
    """Nothing stands in the air: nothing is meshed or solved."""
    if asked != "auto":
        raise SceneError(
            f"rung = {asked!r}: without a body there is nothing to solve; leave the rung out, or add a body"
        )
    air, reynolds = scene.air, scene.reynolds
    assert air is not None
    assert reynolds is not None
    laminar = air.profile == "parabolic" or reynolds < LAMINAR_BELOW
    why = f"nothing stands in it: {air.profile} everywhere, neither mesh nor solver"
    return AirflowPlan("analytic", why, None, "laminar" if laminar else "decaying", symmetric=True, half=False)


def _given(case: str, asked: str) -> AirflowPlan:
    """A user's own solution: nothing is solved, and nothing is known of its symmetry."""
    if asked != "auto":
        raise SceneError(f"rung = {asked!r}: air.case gives the airflow; leave the rung out, or air.case")
    turbulence = "laminar" if is_laminar(Path(case)) else "given"
    return AirflowPlan("given", f"air.case = {case}", None, turbulence, symmetric=False, half=False)


def _auto(reynolds: float, target_error: float) -> tuple[str, str]:
    """The rung that is worth its price, and why."""
    where = f"Re {reynolds:.3g}"
    if reynolds < LAMINAR_BELOW and target_error <= FINE:
        return (
            "reference",
            f"{where}, laminar, {100 * target_error:.2g} % asked for: the mesh is what limits the answer",
        )
    if reynolds < SHEDDING_ABOVE:
        return "draft", f"{where} is below the onset of shedding: the steady solution is the flow itself"
    if reynolds < FLAT_BELOW:
        return "standard", f"{where} sheds vortices in two dimensions: the time-resolved solution is the flow itself"
    return "standard", f"{where} sheds vortices: the truth lies between the steady and the time-resolved wake"


def ranks_for(cells: int, cores: int) -> tuple[int, str]:
    """MPI ranks for a case of so many cells on so many cores, and the reason."""
    ranks = max(1, min(cores, cells // (WORTH_IT // 2)))
    if ranks == 1:
        return 1, f"one process: {cells} cells are too few to share (MPI from {WORTH_IT} cells and two cores)"
    return ranks, f"{ranks} MPI ranks of about {cells // ranks} cells"


def typical_cells(airflow: AirflowPlan, bodies: int) -> float:
    """Cells to expect on the answer's grid, before it is meshed; good to a factor of two."""
    return 0.0 if airflow.stepping is None else CELLS[airflow.stepping] * bodies / airflow.scales[0] ** 2


def typical_seconds(airflow: AirflowPlan) -> float:
    """Seconds of OpenFOAM to expect on one core, its starting solution included; good to a factor of three."""
    if airflow.stepping is None:
        return 0.0
    whole = 1.0 if airflow.half or airflow.stepping == "time-resolved" else 2.5
    one = SECONDS[airflow.stepping] * whole
    first = 0.0 if airflow.stepping == "steady" else SECONDS["steady"] * (1.0 if airflow.symmetric else 2.5)
    return sum(first / scale**2 + one / scale**3 for scale in airflow.scales)
