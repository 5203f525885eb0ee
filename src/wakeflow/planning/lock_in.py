"""Whether the air has to see the body vibrate: where vibration takes over the shedding, and what it changes elsewhere.

The constants are measured (docs/validation.md, "Locked band"): a rhombus at Re 100 that vibrates along the air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..core.errors import SceneError
from ..scene import Scene, Vibration
from .airflow_choice import SHEDDING_ABOVE
from .terms import VIBRATION
from .wake import family_of

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


def vibration_of_scene(scene: Scene, accuracy: float = 0.02, *, asked: bool | None = None) -> AirMotion:
    """What a scene's vibration asks of its airflow: nothing without air or vibration. ``asked``: switched by hand.

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
    if asked is False:
        return AirMotion(False, max(motion.bound, sideways), f"{motion.why}; switched off by --force")
    if scene.vibration.pivot is not None and (motion.used or asked or sideways > _most_sideways(ratios, sheds=sheds)):
        raise SceneError(
            f"vibration.pivot: {motion.why}, sideways a w / U = {sideways:.2g}, and the mesh does not rock; make it "
            f"weaker, or let the air see a body at rest with --force {VIBRATION}=off"
        )
    if sideways > _most_sideways(ratios, sheds=sheds) or (asked and abs(across) > abs(along)):
        raise SceneError(
            f"vibration.direction = {math.degrees(scene.vibration.direction):.3g} deg: sideways at a w / U = "
            f"{sideways:.2g} the body may lock its wake, and the mesh moves along the channel only; turn the vibration "
            f"to 90 deg, make it weaker, or let the air see a body at rest with --force {VIBRATION}=off"
        )
    if scene.vibration.samples is not None and (motion.used or asked):
        raise SceneError(
            f"vibration.samples: {motion.why}, and the mesh follows harmonic vibration only; give frequency and "
            f"amplitude, make it weaker, or let the air see a body at rest with --force {VIBRATION}=off"
        )
    if asked:
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
