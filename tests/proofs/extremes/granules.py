"""Rows of single granules: relaxation times, Reynolds numbers, density ratios, shapes and sizes, in known air."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofs.extremes.flying import against_answer, falls_in_uniform_air, timed_flight, what_happened
from proofs.extremes.matrix import Happened, add_row
from proofs.problems.exact import DENSITY, VISCOSITY, G, Setting, box, field_on, of_tau
from proofs.problems.flights import taylor_green, two_modes
from proofs.problems.reference_all_terms import reference_end_states
from support import without_slip
from wakeflow.air.field import FlowField
from wakeflow.flight import Granules
from wakeflow.laws.drag import slip_correction, terminal_velocity
from wakeflow.laws.gas import MEAN_FREE_PATH
from wakeflow.laws.turbulence import brownian_diffusivity

Array = NDArray[np.float64]
AIR = (DENSITY, VISCOSITY)
WATER = (998.2, 1.002e-3)  # kg/m3, Pa s, at 20 C
LAW = "brown-lawler"
START, SPEED = np.array([0.23, 0.71]), np.array([0.8, -0.3])  # m, m/s, of a granule in Taylor-Green cells
SUBMERGED = ("drag", "gravity", "buoyancy", "added-mass")
SWARM = 1024  # granules whose variance is compared; two directions: standard deviation 1 / sqrt(SWARM)
FORMULA = "scipy's DOP853 or Radau with the drag law's own formula"


def uniform(air: ArrayLike, fluid: tuple[float, float] = AIR, half: float = 1.0) -> FlowField:
    """Uniform air in a square, ``half`` of whose side is given (m)."""
    mesh = box(2, (-half, -half), (half, half))
    return field_on(mesh, np.tile(np.asarray(air, dtype=float), (len(mesh[0]), 1)), density=fluid[0],
                    viscosity=fluid[1])  # fmt: skip


# -- relaxation time ---------------------------------------------------------------------------------------------------


def _in_cells(tau: float) -> Happened:
    """In Taylor-Green cells with a mean stream, until the granule has crossed half a cell."""
    grains = of_tau(tau, [START], [SPEED])
    setting = Setting(field_on(box(12), taylor_green), grains, 0.2, {"drag": "stokes"})
    return against_answer(setting, reference_end_states(setting, stiff=tau < 1e-2, rtol=1e-11)[:, :2])


def _in_rotation(tau: float) -> Happened:
    """In air that turns as a whole, where the motion has a closed form."""
    omega, until = 5.0, 0.5
    end, _ = two_modes(1j * omega, np.array([tau]), 0.3 + 0.13j, 0.5 - 0.4j, until)
    field = field_on(box(6), lambda p: omega * np.stack([-p[:, 1], p[:, 0]], axis=1))
    setting = Setting(field, of_tau(tau, [[0.3, 0.13]], [[0.5, -0.4]]), until, {"forces": ("drag",), "drag": "stokes"})
    return against_answer(setting, np.stack([end.real, end.imag], axis=1))


def _tracer() -> Happened:
    """Of nearly no inertia it stays on its circle, with the air."""
    omega, until, z = 5.0, 1.0, 0.3 + 0.13j
    field = field_on(box(6), lambda p: omega * np.stack([-p[:, 1], p[:, 0]], axis=1))
    start = [[z.real, z.imag]]
    speed = [[-omega * z.imag, omega * z.real]]
    setting = Setting(field, of_tau(1e-9, start, speed), until, {"forces": ("drag",), "drag": "stokes"})
    end = z * np.exp(1j * omega * until)
    return against_answer(setting, np.array([[end.real, end.imag]]))


def _vacuum(tau: float) -> Happened:
    """So heavy, or in air so thin, that it flies a parabola."""
    grains, until = of_tau(tau, [[-0.5, 0.1]], [[1.0, 2.0]], density=1e4), 0.5
    end = grains.position + until * grains.velocity + [0.0, -0.5 * G * until**2]
    field = uniform([0.0, 0.0])
    return against_answer(Setting(field, grains, until, {"drag": "stokes"}), end, tolerance=1e-3)


for _tau in (1e-9, 1e-6, 1e-3, 1.0, 1e3):
    add_row("relaxation time", f"{_tau:g} s, air that turns", partial(_in_rotation, _tau), "closed form")
    add_row("relaxation time", f"{_tau:g} s, curved air", partial(_in_cells, _tau), "scipy on the same interpolant")
add_row("relaxation time", "1e-09 s, no slip", _tracer, "limit: the air's own path, a circle")
add_row("relaxation time", "1000 s, still air", partial(_vacuum, 1e3), "limit: a parabola, to 1e-3")


# -- Reynolds number of the slip ---------------------------------------------------------------------------------------


def _thrown(reynolds: float) -> Happened:
    """A sphere thrown into still air at a Reynolds number: of 20 mm, or finer, at 0.1 m/s; over its way."""
    diameter = min(0.02, reynolds * VISCOSITY / (DENSITY * 0.1))
    speed = reynolds * VISCOSITY / (DENSITY * diameter)
    grains = without_slip(np.array([[-0.9, 0.3]]), np.array([[speed, 0.0]]), diameter, 1300.0)
    until = min(0.3, 1.5 / speed)
    end = falls_in_uniform_air(grains, until, (0.0, 0.0), AIR, LAW, submerged=False)
    way = float(np.linalg.norm(end - grains.position))
    return against_answer(Setting(uniform([0.0, 0.0]), grains, until, {"length": way}), end)


def _no_slip() -> Happened:
    """Born with the air's velocity: drag is nothing at first, and for ever where nothing else acts."""
    air, until = np.array([0.7, -0.4]), 0.5
    diameter = np.array([1e-9, 1e-5, 1e-3, 5e-2])
    start = np.tile([-0.4, 0.3], (4, 1))
    setting = Setting(uniform(air), without_slip(start, np.tile(air, (4, 1)), diameter, 1000.0), until,
                      {"forces": ("drag",)})  # fmt: skip
    return against_answer(setting, start + until * air)


def _begins_to_slip() -> Happened:
    """Born with the air's velocity, and then it falls: the slip grows from nothing."""
    diameter, air = np.array([1e-6, 1e-4, 1e-3, 1e-2]), (0.5, 0.2)
    grains = without_slip(np.tile([-0.4, 0.3], (4, 1)), np.tile(air, (4, 1)), diameter, 1000.0)
    end = falls_in_uniform_air(grains, 0.3, air, AIR, LAW, submerged=False)
    return against_answer(Setting(uniform(air), grains, 0.3), end)


add_row("granule's Reynolds number", "0, and it stays 0", _no_slip, "the air's own path")
add_row("granule's Reynolds number", "0 at birth, then it falls", _begins_to_slip, FORMULA)
for _reynolds in (1e-3, 1.0, 1e3, 1e5, 2e5):
    add_row("granule's Reynolds number", f"{_reynolds:g}", partial(_thrown, _reynolds), FORMULA)


# -- density over that of air or water ---------------------------------------------------------------------------------


def _of_density(ratio: float, fluid: tuple[float, float], diameter: float) -> Happened:
    """Released at rest in a stream, with buoyancy and added mass."""
    stream, until = (0.3, 0.1), 0.3
    grains = without_slip(np.array([[-0.4, 0.1]]), np.zeros((1, 2)), diameter, ratio * fluid[0])
    end = falls_in_uniform_air(grains, until, stream, fluid, LAW, submerged=True)
    return against_answer(Setting(uniform(stream, fluid), grains, until, {"forces": SUBMERGED}), end)


for _ratio in (0.5, 1.0, 2.0, 1e2, 1e4):
    add_row("density over the air's", f"{_ratio:g}", partial(_of_density, _ratio, AIR, 1e-3), FORMULA)
for _ratio in (0.5, 1.0, 2.65, 11.3):
    add_row("density over water's", f"{_ratio:g}", partial(_of_density, _ratio, WATER, 2e-3), FORMULA)


# -- shape and size ----------------------------------------------------------------------------------------------------


def _of_shape(sphericity: float, law: str) -> Happened:
    """Flakes of three sizes thrown into still air."""
    start, speed, diameter = np.tile([-0.6, 0.4], (3, 1)), np.tile([3.0, 1.0], (3, 1)), np.array([1e-4, 1e-3, 5e-3])
    grains = without_slip(start, speed, diameter, 800.0, sphericity=sphericity)
    end = falls_in_uniform_air(grains, 0.2, (0.0, 0.0), AIR, law, submerged=False)
    return against_answer(Setting(uniform([0.0, 0.0]), grains, 0.2, {"drag": law}), end)


for _law in ("haider-levenspiel", "ganser"):
    add_row("sphericity", f"0.1, {_law}", partial(_of_shape, 0.1, _law), FORMULA)


def _four_decades() -> Happened:
    """1 um to 10 mm in one call, so that a block of granules holds stiff and heavy ones."""
    diameter = np.geomspace(1e-6, 1e-2, 9)
    grains = without_slip(np.tile(START, (9, 1)), np.tile(SPEED, (9, 1)), diameter, 1300.0)
    setting = Setting(field_on(box(12), taylor_green), grains, 0.05)
    fine = diameter < 3e-4
    end = np.empty((9, 2))
    for mask, stiff in ((fine, True), (~fine, False)):
        some = Setting(setting.field, grains[mask], setting.until)
        end[mask] = reference_end_states(some, stiff=stiff, rtol=1e-11)[:, :2]
    return against_answer(setting, end)


def _settles(diameter: float) -> Happened:
    """Falls from rest in still air, relative to the way it falls; the finest with the slip of air past it."""
    slips = float(slip_correction(diameter))
    grains = without_slip(np.zeros((1, 2)), np.zeros((1, 2)), diameter, 1000.0, drag_scale=1.0 / slips)
    way = min(float(terminal_velocity(diameter, 1000.0, *AIR, law=LAW, drag_scale=1.0 / slips)), 0.5 * G)
    end = falls_in_uniform_air(grains, 1.0, (0.0, 0.0), AIR, LAW, submerged=False)
    return against_answer(Setting(uniform([0.0, 0.0], half=10.0), grains, 1.0, {"length": way}), end)


def _kicked_by_molecules() -> Happened:
    """Granules of 1 nm in still air: the variance of their places over Einstein's 2 D t."""
    diameter, until = 1e-9, 1e-3
    slips = float(slip_correction(diameter))
    diffusivity = brownian_diffusivity(diameter, VISCOSITY, slip_correction=slips)
    still = np.zeros((SWARM, 2))
    grains = Granules(still, still, diameter, 1000.0)
    spread = float(np.sqrt(2.0 * diffusivity * until))
    tracks, seconds = timed_flight(
        uniform([0.0, 0.0]).with_values(mean_free_path=MEAN_FREE_PATH), grains, until=until, tolerance=1e-3,
        length=spread, forces=("drag", "brownian"), drag="stokes",
    )  # fmt: skip
    return what_happened(tracks, seconds, abs(float(np.mean(tracks.position**2)) / spread**2 - 1.0))


add_row("sizes", "1 um to 10 mm at once", _four_decades, "scipy on the same interpolant")
for _diameter, _name in ((1e-9, "1 nm"), (1e-6, "1 um"), (1e-3, "1 mm"), (5e-2, "50 mm")):
    add_row("sizes", f"{_name} falls", partial(_settles, _diameter), f"{FORMULA}, over the way")
add_row("sizes", "1 nm, Brownian motion", _kicked_by_molecules, "Einstein's 2 D t, 4 standard deviations",
     unit="relative", allowed=4.0 / SWARM**0.5)  # fmt: skip
