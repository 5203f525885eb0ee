"""Which airflow a scene needs: the plan of its rung (``scene.rungs``). What it will cost is in :mod:`.cost`.

Whether it has to see the body vibrate: where vibration takes over the shedding, and what it changes elsewhere. The
constants of that are measured (docs/validation.md, "Locked band"): a rhombus at Re 100 that vibrates along the air.

Above the onset of three-dimensional motion the steady and the time-resolved solution in two dimensions bracket the
truth: the one has too long a wake and too weak a suction, the other sheds too coherently. Where the wake is turbulent
the answer is a best estimate between these two ends (``wake``). Without a body, and at rest, the air is known
(analytic); a user's own case is measured, not solved (given).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from ..core.errors import SceneError
from ..core.geometry import is_symmetric
from ..core.graded import Notice, information, less_sure
from ..core.quantities import metres
from ..core.record import Null, column
from ..laws.best_estimate import NO_ESTIMATE, WakeEstimate
from ..laws.driven_jet import width_after
from ..laws.span import IN_PLANE, Span
from ..laws.turbulence import SPANWISE, model_at, turbulence_models
from ..scene import Scene, Vibration
from ..scene.rungs import check_rung, rungs
from ..scene.user_files import is_laminar
from .terms import LOADING, VIBRATION
from .wake import Wake, family_of, span_of, wake_of, wakes_beside

Stepping = Literal["steady", "time-resolved", ""]
SOLVED: dict[str, Stepping] = {
    "steady": "steady",
    "time-resolved": "time-resolved",
    "three-dimensional": "time-resolved",
}  # kinds that OpenFOAM solves
# Reynolds numbers on the body's width and the inlet's mean speed.
SHEDDING_ABOVE = 27.7  # a flat plate's onset, the lowest (triangle 34.3, circle 46.2: Jackson 1987, J. Fluid Mech. 182)
# walls raise it (36, 60, 91 at blockages of 1/8, 1/4, 1/2: Parveez, Dhiman & Rasool 2014, a trapezoidal prism)
FLAT_BELOW = 160.0  # two-dimensional below: mode A of a square's wake at 161 (Robichaux 1999), of a circle's near 190
LAMINAR_BELOW = turbulence_models["laminar"].reynolds[1]  # above it a turbulence model runs
DECAYING = "decaying"  # the turbulence of air past no body
JET = "jet"  # that of air which granules alone drive
JET_ROOM = 8.0  # channel widths over a jet's b that count as wide: twice the 4 b which hold all but 0.5 % of its flux
MIN_TURBULENCE = 0.001  # inlet intensity below which a turbulence model has no scale of its own; wind tunnels reach it
FINE = 0.005  # accuracy of a share that pays for three grids where the mesh is what limits it
ACCURACY = {
    "flat": 0.02,
    "bracket": 0.05,
}  # of the airflow's statistics: usual; where model errors are tens of per cent
# Reynolds number of a plane channel (mean speed, plate distance) above which turbulence lasts: Patel & Head 1969, J.
LAMINAR_CHANNEL = 1300.0  # Fluid Mech. 38, 181


@dataclass(frozen=True)
class AirflowPlan:
    """How the airflow is computed.

    This class plans an airflow that is known without a solver; each other kind of airflow has a class of its own.
    """

    rung: str = column("", "none, analytic, draft, standard, reference, 3d or given")
    why: str = column("", "why this rung")
    stepping: Annotated[Stepping, Null("")] = column("", "steady or time-resolved; null without a solver")
    turbulence: Annotated[str, Null("")] = column(
        "",
        "turbulence model, decaying in air past no body, jet in air that granules alone drive, given in a case of the "
        "user's",
    )
    symmetric: bool = column("", "whether the geometry is its own mirror image about x = 0")
    half: bool = column("", "whether only half of the channel is solved, the other being its mirror image")
    scales: tuple[float, ...] = column(
        "1", "cell edges over the rung's own, one a grid, the answer's first", default=(1.0,)
    )
    brackets: bool = column(
        "", "whether steady and time-resolved wake bracket the truth, and both are flown in", default=False
    )
    moving: bool = column("", "whether the mesh vibrates with the body; else the air sees it at rest", default=False)
    loaded: bool = column("", "whether the air feels the granules", default=False)
    accuracy: float = column(
        "1", "relative half width of the intervals of drag, base pressure and shedding at which a time-resolved run "
        "may end", default=0.02,
    )  # fmt: skip
    wake: Annotated[WakeEstimate, Null(NO_ESTIMATE)] = column(
        "", "how much of the time-resolved wake the answer is flown in; null where it is that wake or no end",
        default=NO_ESTIMATE,
    )  # fmt: skip
    span: Annotated[Span, Null(IN_PLANE)] = column(
        "", "the third dimension; null where the airflow is plane", default=IN_PLANE
    )

    @property
    def turbulent(self) -> bool:
        """Whether the wake is turbulent: by the model that runs, or in a user's case that brings k."""
        solved = self.turbulence in turbulence_models and turbulence_models[str(self.turbulence)].turbulent
        return solved or self.turbulence == "given"

    @property
    def kind(self) -> str:
        """The name among ``air.kinds.airflow_kinds`` of what computes this airflow."""
        return (rungs[self.rung].kind if self.rung in rungs else "") or self.rung

    @property
    def mirrored(self) -> bool:
        """Whether half of the granules fly in the airflow's mirror image: it is as likely where nothing tells left
        from right, and a wake, computed whole, may lean.
        """
        return self.stepping != "" and self.symmetric and not self.half

    @property
    def effects(self) -> frozenset[str]:
        """The terms among ``planning.terms`` that are computed with the airflow, for all fractions."""
        return frozenset(term for term, on in ((VIBRATION, self.moving), (LOADING, self.loaded)) if on)

    @property
    def wakes_beside(self) -> dict[Wake, tuple[float, float]]:
        """Theta and strength of the wakes in which part of the granules fly for the error of the airflow's model."""
        return wakes_beside(self.brackets, self.wake)

    @property
    def resolves(self) -> str:
        """The rung that resolves what this airflow leaves out where the wake sheds; empty where nothing is left out."""
        return rungs[self.rung].resolves if self.rung in rungs else ""

    @property
    def summary(self) -> str:
        """The plan's line on an airflow that is not solved; empty where there is nothing to say."""
        return f"airflow: rung {self.rung}, {rungs[self.rung].meaning} ({self.why})"

    def flown(self, scene: Scene) -> Scene:
        """The scene that granules are flown through."""
        return scene.with_top()

    def feeling(self, scene: Scene, *, loaded: bool) -> AirflowPlan:
        """This plan for an airflow which the granules' force moves or not: where gravity is at an angle to the channel,
        or the feed is not its own mirror image, it is none under that force. Air that feels no granules feels neither.
        """
        uneven = loaded and not (scene.plumb.upright and scene.feed.symmetric)
        return replace(self, loaded=loaded, symmetric=self.symmetric and not uneven, half=self.half and not uneven)

    def notices(self, scene: Scene) -> Iterator[Notice]:
        """One notice for each way in which the airflow of ``scene`` differs from the real one."""
        del scene
        return iter(())


class NoAirPlan(AirflowPlan):
    """No air, or air that is left out."""

    @property
    def summary(self) -> str:
        return ""

    def flown(self, scene: Scene) -> Scene:
        return scene.without_air()


class AnalyticAirPlan(AirflowPlan):
    """Air without bodies, or at rest: known in closed form."""

    @property
    def summary(self) -> str:
        return f"airflow: {self.why}"

    def feeling(self, scene: Scene, *, loaded: bool) -> AirflowPlan:
        made = super().feeling(scene, loaded=loaded)
        if not loaded:
            return made
        why = "the granules alone drive it: a jet by their force, neither mesh nor solver"
        return replace(made, why=why, turbulence=JET)

    def notices(self, scene: Scene) -> Iterator[Notice]:
        reynolds, parabolic = scene.reynolds, scene.air is not None and scene.air.profile == "parabolic"
        if parabolic and reynolds > LAMINAR_CHANNEL:
            yield less_sure(
                f"parabolic air at Re {reynolds:.3g} on the channel's width: in reality it would be turbulent; "
                "air.profile = 'uniform' is nearer to that"
            )
        if self.loaded and scene.channel.width < JET_ROOM * width_after(scene.drop):
            yield less_sure(
                "the air that the granules drive comes to fill the channel, which is taken for wide and open at its "
                f"sides: {metres(JET_ROOM * width_after(scene.drop), 2)} would be wide"
            )


class GivenAirPlan(AirflowPlan):
    """A solved OpenFOAM case of the user's."""

    @property
    def summary(self) -> str:
        return f"airflow: a solved OpenFOAM case of yours; neither mesh nor solver runs ({self.why})"


class SolvedAirPlan(AirflowPlan):
    """An airflow that OpenFOAM solves, steady or time-resolved, in the plane or in three dimensions."""

    @property
    def kind(self) -> str:
        if self.span:
            return "three-dimensional"
        return "best-estimate" if self.wake else str(self.stepping)

    def notices(self, scene: Scene) -> Iterator[Notice]:
        if self.resolves and scene.reynolds > SHEDDING_ABOVE:
            yield less_sure(
                f"{self.rung} airflow: a steady wake is too long and its suction too weak; numerics.rung = "
                f"'{self.resolves}' resolves the shedding"
            )
        if self.wake:
            theta = self.wake.theta
            yield information(
                f"{self.rung} airflow: a best estimate between two wakes in two dimensions, of which neither is real; "
                f"the share of the one that sheds is known to be {theta.low:.2f} to {theta.high:.2f}; numerics.rung = "
                "'3d' computes the real one, with numerics.mesh_scale = 1.6 in some 40 minutes of one core a body"
            )
        elif self.brackets:
            yield less_sure(
                f"{self.rung} airflow: a two-dimensional wake sheds too coherently, its suction is too strong; the "
                "truth lies between it and numerics.rung = 'draft'"
            )


def choose_airflow(scene: Scene, rung: str, target_error: float) -> AirflowPlan:
    """The airflow of a rung asked for; ``auto`` goes by Reynolds number and the accuracy asked for (a share).

    Raises SceneError for a rung that the scene cannot have, and for turbulent air without turbulence.
    """
    how = _chosen(scene, rung, target_error)
    enters = how.turbulence == DECAYING or (how.turbulent and how.turbulence != "given")
    if enters and scene.airstream.turbulence < MIN_TURBULENCE:
        raise SceneError(
            f"air.turbulence = {scene.airstream.turbulence:g}: the air is turbulent here (allowed: >= 0.1 %; 0 is for "
            "laminar air)"
        )
    return how


def _chosen(scene: Scene, rung: str, target_error: float) -> AirflowPlan:
    """The airflow of a rung asked for, whatever turbulence the scene gives it."""
    check_rung(rung)
    if scene.air is None:
        if rungs[rung].needs_air:
            raise SceneError(f"rung = {rung!r} needs an [air] table; leave the rung out for a vacuum")
        return NoAirPlan("none", "there is no [air]", "", "", scene.symmetric, half=False)
    if rungs[rung].kind == "none":
        if not scene.body:
            raise SceneError(f"rung = {rung!r} leaves the air out, and without a body nothing is left: choose auto")
        return NoAirPlan(rung, "asked for: the air is left out", "", "", scene.symmetric, half=False)
    if not scene.body or scene.air.still:
        return _analytic(scene, rung)
    if scene.air.case:
        return _given(scene.air.case, rung)
    name, why = (rung, "asked for") if rungs[rung].kind else _auto(scene.reynolds, target_error)
    return _at_body(scene, scene.reynolds, name, why)


def _at_body(scene: Scene, reynolds: float, name: str, why: str) -> AirflowPlan:
    """The airflow past the scene's bodies at a rung that names its kind."""
    rung, sheds, symmetric = rungs[name], reynolds >= SHEDDING_ABOVE, scene.symmetric
    kind = str(rung.kind if sheds else rung.kind_below_shedding or rung.kind)
    if kind not in SOLVED:
        return AirflowPlan(name, why, "", "laminar", symmetric, half=False)
    if kind == "three-dimensional":
        return SolvedAirPlan(
            name, why, SOLVED[kind], SPANWISE, symmetric, half=False, accuracy=ACCURACY["bracket"], span=span_of(scene)
        )
    steady, model = kind == "steady", model_at(reynolds)
    brackets = not steady and reynolds > FLAT_BELOW
    return SolvedAirPlan(
        rung=name,
        why=why,
        stepping=SOLVED[kind],
        turbulence=model.name,
        symmetric=symmetric,
        half=steady and symmetric and all(is_symmetric(body.outline()) for body in scene.body.values()),
        scales=rung.scales,
        brackets=brackets,
        accuracy=scene.numerics.averaging or rung.accuracy or ACCURACY["bracket" if reynolds > FLAT_BELOW else "flat"],
        wake=wake_of(scene, reynolds) if brackets and model.turbulent else NO_ESTIMATE,
    )


def _analytic(scene: Scene, rung: str) -> AirflowPlan:
    """The plan of a channel without bodies, or of air at rest: nothing is meshed or solved."""
    air = scene.airstream
    if rung != "auto":
        why, cure = ("the air is at rest", "give air.speed") if air.still else ("there is no body", "add one")
        raise SceneError(f"rung = {rung!r}: {why}, so there is nothing to solve; leave the rung out, or {cure}")
    if air.still:
        why = "the air is at rest, and what bodies and granules stir up in it is left out: neither mesh nor solver"
        return AnalyticAirPlan("analytic", why, "", "laminar", scene.symmetric, half=False)
    laminar = air.profile == "parabolic" or scene.reynolds < LAMINAR_BELOW
    why = f"it has no body: {air.profile} everywhere, neither mesh nor solver"
    return AnalyticAirPlan("analytic", why, "", "laminar" if laminar else DECAYING, symmetric=True, half=False)


def _given(case: str, rung: str) -> AirflowPlan:
    """The plan of a user's own solution: nothing is solved, and nothing is known of its symmetry."""
    if rung != "auto":
        raise SceneError(f"rung = {rung!r}: air.case gives the airflow; leave the rung out, or air.case")
    turbulence = "laminar" if is_laminar(Path(case)) else "given"
    return GivenAirPlan("given", f"air.case = {case}", "", turbulence, symmetric=False, half=False)


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
    return "standard", f"{where} sheds vortices: a best estimate between the steady and the time-resolved wake"


# -- Whether the air has to see the body vibrate -----------------------------------------------------------------------
MAX_NEGLECTED_MOTION = 0.1  # a w / U above which the body's motion is never left out
ANYWHERE = 1.3  # largest change of mean drag or base pressure over a w / U, locked or not, up to MAX_NEGLECTED_MOTION
BESIDE = 0.3  # the same outside the bands
BANDS = {1.0: (0.05, 1.0), 2.0: (0.1, 2.0)}  # half width of the band about f / fs: constant, and per a w / U
STROUHAL = (0.12, 0.21)  # f D / U_gap, U_gap = U / (1 - blockage): plate 0.123 to 0.145, square 0.13 to 0.146,
# triangle 0.13 (base first) to 0.2 (apex first), circle 0.16 to 0.21, rhombus 0.17 (docs/validation.md)
ACROSS, ACROSS_BAND = 0.02, (0.6, 1.4)  # sideways: a third of the least amplitude that locks a circle's wake (0.05 D at
# f = fs: Koopmann 1967, J. Fluid Mech. 28, 501), as a w / U; beyond the widest band at the largest amplitudes there
# What leaving the motion out changes of shares in turbulent air, within 95 %, even where the wake locks: measured
# (docs/validation.md, "Air that sees the body vibrate") of such a body, and taken for those like it
SHARES_MOVED = 0.03
MEASURED_FAMILY, MEASURED_SLOPES, MEASURED_REYNOLDS = "rhombus", (40.0, 50.0), (5e3, 5e4)  # deg, of 45; of 16 500
MEASURED_MOTION = 0.021  # a w / U


@dataclass(frozen=True)
class AirMotion:
    """Whether the mesh has to move with the body. ``bound``: by which share leaving it out may change mean drag or base
    pressure; ``why``: in words, empty where nothing vibrates in air; ``moved``: by how
    much it changes a share at most, infinite where that was not measured.
    """

    used: bool = False
    bound: float = 0.0
    why: str = ""
    moved: float = math.inf


def vibration_of_air(
    speed_ratio: float, frequency_ratio: float | tuple[float, float], accuracy: float = 0.02, *, sheds: bool = True
) -> AirMotion:
    """Whether vibration along the air can be left out of the airflow.

    ``speed_ratio`` a w / U; ``frequency_ratio`` f / fs, or the range it lies in where the shedding frequency fs is not
    known yet; ``accuracy``: the share that is asked of mean drag and base pressure. ``sheds``: False below the onset of
    vortex shedding, where nothing can lock.

    Left out where a w / U is below MAX_NEGLECTED_MOTION and the frequency outside the bands about fs and 2 fs; and
    wherever even a locked wake differs by less than ``accuracy``. Measured at Re 100 on one rhombus; taken to hold for
    other bodies and Reynolds numbers.
    """
    low, high = frequency_ratio if isinstance(frequency_ratio, tuple) else (frequency_ratio, frequency_ratio)
    speed = abs(speed_ratio)
    words = f"{low:.2g}" if low == high else f"{low:.2g} to {high:.2g}"
    what = f"a w / U = {speed:.2g} at f / fs = {words}"
    if speed > MAX_NEGLECTED_MOTION:
        return AirMotion(
            True,
            ANYWHERE * speed,
            f"{what}: above the {MAX_NEGLECTED_MOTION:g} up to which leaving it out was measured",
        )
    near = [at for at in BANDS if sheds and low <= at + half_width(at, speed) and high >= at - half_width(at, speed)]
    if not near:
        where = "away from fs and 2 fs" if sheds else "the wake does not shed, nothing can lock"
        return AirMotion(False, BESIDE * speed, f"{what}: small, and {where}")
    if ANYWHERE * speed <= accuracy:
        return AirMotion(False, ANYWHERE * speed, f"{what}: too slow to matter even if the wake locks")
    band = " and ".join(f"{at:g} fs" for at in near)
    return AirMotion(True, ANYWHERE * speed, f"{what}: the wake may lock near {band}")


def half_width(at: float, speed_ratio: float) -> float:
    """Half width, in f / fs, of the band about ``at`` (1 or 2) in which the vibration is felt."""
    constant, slope = BANDS[at]
    return constant + slope * speed_ratio


def frequency_ratios(scene: Scene, vibration: Vibration) -> tuple[float, float]:
    """The range in which f / fs of a scene with a ``vibration`` lies, before its airflow is known; of samples from
    their period's to that of their fastest change.
    """
    width = scene.width
    reduced = width / scene.airstream.speed * (1.0 - width / scene.channel.width)
    slow = 1.0 / vibration.period
    fast = slow if vibration.samples is None else vibration.record.pace / (2.0 * math.pi)
    return slow * reduced / STROUHAL[1], fast * reduced / STROUHAL[0]


def vibration_of_scene(scene: Scene, accuracy: float = 0.02, *, switched: bool | None = None) -> AirMotion:
    """What a scene's vibration asks of its airflow: nothing without air or vibration. ``switched``: by hand.

    The mesh can follow a harmonic along the channel. Raises SceneError for what it cannot follow, sideways vibration
    and samples, where that could lock the wake, or is switched on.
    """
    if scene.air is None or scene.vibration is None:
        return AirMotion()
    across, along = scene.shaking
    ratios = frequency_ratios(scene, scene.vibration)
    sheds = scene.reynolds >= SHEDDING_ABOVE
    sideways = abs(float(across)) / scene.air.speed
    motion = vibration_of_air(float(along) / scene.air.speed, ratios, accuracy, sheds=sheds)
    if switched is False:
        return AirMotion(False, max(motion.bound, sideways), f"{motion.why}; switched off by --force")
    if scene.vibration.pivot is not None and (
        motion.used or switched or sideways > _most_sideways(ratios, sheds=sheds)
    ):
        raise SceneError(
            f"vibration.pivot: {motion.why}, sideways a w / U = {sideways:.2g}, and the mesh does not rock; make it "
            f"weaker, or let the air see a body at rest with --force {VIBRATION}=off"
        )
    if sideways > _most_sideways(ratios, sheds=sheds) or (switched and abs(across) > abs(along)):
        raise SceneError(
            f"vibration.direction = {math.degrees(scene.vibration.direction):.3g} deg: sideways at a w / U = "
            f"{sideways:.2g} the body may lock its wake, and the mesh moves along the channel only; turn the vibration "
            f"to 90 deg, make it weaker, or let the air see a body at rest with --force {VIBRATION}=off"
        )
    if scene.vibration.samples is not None and (motion.used or switched):
        raise SceneError(
            f"vibration.samples: {motion.why}, and the mesh follows harmonic vibration only; give frequency and "
            f"amplitude, make it weaker, or let the air see a body at rest with --force {VIBRATION}=off"
        )
    if switched:
        motion = AirMotion(True, motion.bound, f"{motion.why}; switched on by --force")
    if sideways > 1e-9:
        return AirMotion(motion.used, max(motion.bound, sideways), f"{motion.why}; its sideways part is left out")
    measured = not motion.used and scene.vibration.pivot is None and _measured(scene, float(along) / scene.air.speed)
    return replace(motion, moved=SHARES_MOVED) if measured else motion


def _measured(scene: Scene, speed_ratio: float) -> bool:
    """Whether it was measured what vibration along the air with a w / U = ``speed_ratio`` changes of shares."""
    family, (flat, steep), (low, high) = family_of(scene), MEASURED_SLOPES, MEASURED_REYNOLDS
    alike = family.name == MEASURED_FAMILY and flat <= family.slope <= steep
    return alike and low <= scene.reynolds <= high and abs(speed_ratio) <= MEASURED_MOTION


def _most_sideways(ratios: tuple[float, float], *, sheds: bool) -> float:
    """Largest sideways a w / U that is left out."""
    locks = sheds and ratios[0] <= ACROSS_BAND[1] and ratios[1] >= ACROSS_BAND[0]
    return ACROSS if locks else MAX_NEGLECTED_MOTION
