"""The records of the forces that need no more than a few lines each; the history force has a module of its own."""

from __future__ import annotations

import math

import numpy as np

from ..drag import slip_correction
from ..flake import plate_lift, plate_torque
from ..lift import lift_coefficient, magnus_factor, spin_rate
from ..turbulence import brownian_diffusivity, crossing_times
from .force import AirProperties, Bound, FlightScales, Force, Grains, Instant, Slots, Vector, drag_scale

# -- Weight ------------------------------------------------------------------------------------------------------------
GRAVITY_FORCE = Force(
    name="gravity",
    means="weight",
    source="g",
    needs="nothing",
    calm=True,
    acceleration=lambda grains, _air, gravity: np.tile(gravity, (len(grains), 1)),
    reference=lambda now: now.granule.gravity,
)


# -- Buoyancy ----------------------------------------------------------------------------------------------------------
def _buoyancy_shift(flight: FlightScales) -> float:
    return flight.slope * flight.widths(flight.steady(flight.ratio * flight.gravity, flight.whole))


BUOYANCY = Force(
    name="buoyancy",
    means="weight of the displaced air",
    source="Archimedes; OpenFOAM's p has no hydrostatic part",
    calm=True,
    bound=Bound(_buoyancy_shift, "g rho/rho_p over the whole flight, times the slope of the track at its end"),
    acceleration=lambda grains, air, gravity: -((air.density / grains.density)[:, None] * gravity),
    reference=lambda now: (-now.granule.ratio * now.granule.gravity[0], -now.granule.ratio * now.granule.gravity[1]),
)


# -- Drag --------------------------------------------------------------------------------------------------------------
def _drag_factors(grains: Grains, air: AirProperties) -> Slots:
    """STOKES (1/s): rate of Stokes drag, 18 mu / (rho_p d^2), times the factor on the law."""
    return {"STOKES": drag_scale(grains, air) * 18.0 * air.viscosity / (grains.density * grains.diameter**2)}


def _drag_reference(now: Instant) -> Vector:
    granule = now.granule
    stokes = granule.drag_scale * 18 * granule.viscosity / (granule.density * granule.diameter**2)
    rate = stokes * granule.drag_factor(now.reynolds)
    return rate * now.slip[0], rate * now.slip[1]


DRAG = Force(
    name="drag",
    means="drag of the air at the slip velocity",
    source="laws/drag.py: a registered law for each fraction",
    calm=True,
    factors=_drag_factors,
    reference=_drag_reference,
)


# -- The air's pressure gradient ---------------------------------------------------------------------------------------
def _pressure_gradient_shift(flight: FlightScales) -> float:
    return flight.widths(flight.passage(flight.ratio * flight.flow_acceleration, flight.near))


def _pressure_gradient_reference(now: Instant) -> Vector:
    density = now.granule.density
    return -(now.pressure_gradient[0] / density), -(now.pressure_gradient[1] / density)


PRESSURE_GRADIENT = Force(
    name="pressure-gradient",
    means="-grad p / rho_p: what presses a granule into the suction zone",
    source="rho Du/Dt of Maxey, M.R. & Riley, J.J. 1983, Phys. Fluids 26, 883, in its mean over eddies: Minier, J.-P. "
    "& Peirano, E. 2001, Phys. Rep. 352, 1",
    needs="pressure",
    bound=Bound(_pressure_gradient_shift, "rho/rho_p U^2/D within 3 D of the body"),
    factors=lambda grains, _air: {"PRESSURE": -1.0 / grains.density},  # m3/kg
    reference=_pressure_gradient_reference,
)


# -- Added mass --------------------------------------------------------------------------------------------------------
def _added_mass_shift(flight: FlightScales) -> float:
    granule = max(flight.landing, flight.arrival) * flight.reach(flight.whole)  # by its own change of velocity
    return flight.widths(0.5 * flight.ratio * (flight.passage(flight.flow_acceleration, flight.near) + granule))


def _added_mass_reference(now: Instant) -> Vector:
    chi = 0.5 * now.granule.ratio
    return chi * now.air_acceleration[0], chi * now.air_acceleration[1]


ADDED_MASS = Force(
    name="added-mass",
    means="half the displaced air's mass takes part in the difference of accelerations; inside the inertia",
    source="Auton, T.R., Hunt, J.C.R. & Prud'homme, M. 1988, J. Fluid Mech. 197, 241",
    calm=True,
    by_gradient=True,
    bound=Bound(
        _added_mass_shift, "rho/2rho_p times U^2/D within 3 D of the body and the granule's own change of velocity"
    ),
    # chi = rho / (2 rho_p): half of the displaced air's mass over the granule's, by which Du/Dt acts too
    inertia=lambda grains, air: 0.5 * (air.density / grains.density),
    factors=lambda grains, air: {"INERTIAL": 0.5 * (air.density / grains.density)},
    reference=_added_mass_reference,
    reference_inertia=lambda granule: 0.5 * granule.ratio,
)

# -- Shear lift --------------------------------------------------------------------------------------------------------
SHEAR = 20.0  # U / D: vorticity of a wake's shear layer; chosen: the lift goes with its square root


def _shear_shift(flight: FlightScales) -> float:
    shear = SHEAR * flight.air_speed / flight.width
    scale = flight.air_density * flight.diameter / flight.viscosity
    coefficient = lift_coefficient(scale * flight.typical_slip, scale * flight.diameter * shear)
    kick = flight.ratio * coefficient * flight.typical_slip * flight.turned
    return flight.widths(kick * flight.reach(flight.time))


def _shear_reference(now: Instant) -> Vector:
    c = now.granule.ratio * lift_coefficient(now.reynolds, now.rotation_reynolds(now.curl))
    return c * now.slip[1] * now.curl, -(c * now.slip[0] * now.curl)


SHEAR_LIFT = Force(
    name="lift",
    means="shear lift: across the slip in air that turns",
    source="Saffman, P.G. 1965, J. Fluid Mech. 22, 385; Mei, R. 1992, Int. J. Multiphase Flow 18, 145",
    by_gradient=True,
    bound=Bound(
        _shear_shift,
        "Saffman-Mei: slip times the angle through which the air turns across the shear layers that are met",
    ),
    factors=lambda grains, air: {"LIFT": air.density / grains.density},  # times the compiled coefficient
    reference=_shear_reference,
)


# -- Spin lift ---------------------------------------------------------------------------------------------------------
def _spin_shift(flight: FlightScales) -> float:
    rolls = flight.thrown if flight.calm or flight.kept else flight.arrival
    spin = rolls / (0.5 * flight.diameter)  # off a slope or a wall
    scale = flight.air_density * flight.diameter / flight.viscosity
    lift = 0.75 * flight.ratio * magnus_factor(scale * flight.typical_slip, scale * flight.diameter * spin)
    lasting = 1.0 / float(spin_rate(flight.diameter, flight.density, flight.viscosity))
    by_granule = flight.passage(lift * spin * flight.typical_slip, lasting)
    by_air = 0.75 * flight.ratio * flight.typical_slip * 0.5 * flight.turned * flight.reach(flight.time)
    return flight.widths(by_granule + by_air)


def _spin_factors(grains: Grains, air: AirProperties) -> Slots:
    """MAGNUS: 3/4 rho / rho_p, times the compiled factor; of flakes their own."""
    ratio = air.density / grains.density
    return {"MAGNUS": grains.spin_lift * np.where(grains.flake, plate_lift(grains.shape, ratio), 0.75 * ratio)}


def _spin_constants(grains: Grains, air: AirProperties) -> Slots:
    """SPIN_RATE (1/s): rate at which the air takes a spin away; of flakes SPIN_TORQUE, which grows with the spin."""
    torque = np.where(grains.flake, plate_torque(grains.shape, air.density / grains.density), 0.0)
    rate = spin_rate(grains.diameter, grains.density, air.viscosity, grains.inertia)
    return {"SPIN_RATE": rate, "SPIN_TORQUE": torque}


def _spin_reference(now: Instant) -> Vector:
    relative = 0.5 * now.curl - now.spin
    c = 0.75 * now.granule.ratio * magnus_factor(now.reynolds, now.rotation_reynolds(relative)) * relative
    return -(c * now.slip[1]), c * now.slip[0]


def _spin_torque(now: Instant) -> float:
    """The torque of Dennis, Singh & Ingham 1980 over the creeping one, written out once more as they print it."""
    granule, relative = now.granule, 0.5 * now.curl - now.spin
    fast = now.rotation_reynolds(relative)
    slowing = 24 * granule.viscosity / (granule.inertia * granule.density * granule.diameter**2)
    return slowing * relative * max(1.0, (12.9 * math.sqrt(fast) + 128.4) / (64 * math.pi))


SPIN_LIFT = Force(
    name="magnus",
    means="spin lift across the slip, and the air's torque on the spin",
    source="Rubinow, S.I. & Keller, J.B. 1961, J. Fluid Mech. 11, 447; Loth, E. 2008, AIAA J. 46, 801",
    turns=True,
    by_gradient=True,
    bound=Bound(_spin_shift, "Loth: spin of a sphere that leaves the slope rolling, and half the air's turning"),
    factors=_spin_factors,
    constants=_spin_constants,
    reference=_spin_reference,
    torque=_spin_torque,
)

# -- Dispersion --------------------------------------------------------------------------------------------------------
WAKE_INTENSITY = 0.3  # u' / U behind a bluff body; chosen: an estimate, and the bound's reason says so
EDDY = 0.2  # body widths: integral length of the turbulence in the wake; chosen likewise
TWO_SIGMA = 2.0  # standard deviations that hold 95 % of a normal shift
EFFORT = 1.0  # measured on cases/rhombus.toml: a flight takes 1.4 (dust) to 1.8 times (wheat) as long


def eddy_way(flight: FlightScales) -> float:
    """How far (m) eddies carry what follows them while it is near the body, 95 % of it: 2 sqrt(2 u'^2 T_L near)."""
    strength = max(flight.intensity, WAKE_INTENSITY) if flight.turbulent else flight.intensity
    rms = strength * flight.air_speed
    if rms == 0.0:
        return 0.0
    lifetime = crossing_times(EDDY * flight.width / rms, flight.typical_slip, rms)[0]
    return TWO_SIGMA * math.sqrt(2.0 * rms**2 * lifetime * flight.near)


def _dispersion_shift(flight: FlightScales) -> float:
    return eddy_way(flight) * flight.reach(flight.time) / flight.tau / flight.width


DISPERSION = Force(
    name="dispersion",
    means="the turbulent velocity that the mean field does not hold, as a Langevin process",
    source="Thomson, D.J. 1987, J. Fluid Mech. 180, 529; Bocksell, T.L. & Loth, E. 2006, Int. J. Multiphase Flow 32, "
    "1234",
    needs="turbulence",
    random=True,
    effort=EFFORT,
    bound=Bound(
        _dispersion_shift,
        "an estimate: 2 sqrt(2 u'^2 T_L T) at u' = 0.3 U near the body, less for granules slow to follow",
    ),
    constants=lambda _grains, _air: {"DISPERSION": 1.0},  # a flag; the eddies come with the field
)


# -- Brownian motion ---------------------------------------------------------------------------------------------------
def _brownian_shift(flight: FlightScales) -> float:
    slips = float(slip_correction(flight.diameter, flight.mean_free_path))
    diffusivity = brownian_diffusivity(flight.diameter, flight.viscosity, flight.temperature, slips)
    return flight.widths(TWO_SIGMA * math.sqrt(2.0 * diffusivity * flight.whole))


def _brownian_constants(grains: Grains, air: AirProperties) -> Slots:
    """DIFFUSIVITY (m2/s) among the air's molecules."""
    slips = slip_correction(grains.diameter, air.mean_free_path)
    return {"DIFFUSIVITY": brownian_diffusivity(grains.diameter, air.viscosity, air.temperature, slips)}


BROWNIAN_MOTION = Force(
    name="brownian",
    means="kicks of the air's molecules",
    source="Einstein, A. 1905, Ann. Phys. 322, 549; Li, A. & Ahmadi, G. 1992, Aerosol Sci. Technol. 16, 209",
    random=True,
    bound=Bound(_brownian_shift, "2 sqrt(2 D T), D = k_B T Cc / (3 pi mu d)"),
    constants=_brownian_constants,
)
