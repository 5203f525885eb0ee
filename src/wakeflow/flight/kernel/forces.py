"""The compiled terms of the forces: drag by table, added mass, shear lift, spin lift, and how the air turns a granule.

Formulas and sources are in ``laws``; what is constant of a term for one granule (``at.STOKES`` to ``at.SPIN_RATE``) is
packed before the flight. Gravity, buoyancy and pressure gradient are in the loaded air (``air.load_triangle``).
"""

from __future__ import annotations

import math

from ...laws import lift
from ...laws import lift as rotation
from ...laws.drag import TABLE_CELLS, TABLE_DECADES
from . import layout as at
from .air import air_at, gradient_at, rise_at
from .jit import compiled

lift_coefficient = compiled(lift.lift_coefficient)
magnus_factor = compiled(rotation.magnus_factor)
spin_decay = compiled(rotation.spin_decay)
plate_spin = compiled(rotation.plate_spin)

# Where a Reynolds number is in the table of drag factors, and the inverse of the table's last
FIRST_CELL = float(TABLE_DECADES[0] * TABLE_CELLS)
PER_HALF_NATURAL_LOG = 0.5 / math.log(10.0) * TABLE_CELLS
BEYOND = 10.0 ** -TABLE_DECADES[1]


@compiled
def drag_rate(grain, table, slip2):
    """B = f(Re) / tau (1/s) at a squared slip velocity, from the table of the drag law."""
    if grain[at.STOKES] == 0.0:
        return 0.0
    re2 = grain[at.REYNOLDS2] * slip2
    if re2 <= 1e-16:
        return grain[at.STOKES] * table[0, 0]
    place = PER_HALF_NATURAL_LOG * math.log(re2) - FIRST_CELL
    cells = table.shape[0]
    extra = 1.0
    if place >= cells:
        extra = math.sqrt(re2) * BEYOND
        place = cells - 1e-9
    i = int(place)
    w = place - i
    return grain[at.STOKES] * extra * (table[i, 0] + w * (table[i, 1] + w * (table[i, 2] + w * table[i, 3])))


@compiled
def spin_at(affine, grain, spin, t, s):
    """Spin at time s after t: the air of the loaded triangle turns it exactly, with its vorticity half way."""
    _, xy, yx, _ = gradient_at(affine, t + 0.5 * s)
    return spin_in_curl(grain, spin, yx - xy, s)


@compiled
def spin_in_curl(grain, spin, curl, s):
    """Spin after a time s in air of the vorticity ``curl`` (1/s)."""
    half = 0.5 * curl
    if grain[at.SPIN_TORQUE] != 0.0:
        return half - plate_spin(half - spin, s, grain[at.SPIN_TORQUE])
    return half - spin_decay(half - spin, s, grain[at.SPIN_RATE], grain[at.VORTICITY])


@compiled
def gradient_forces(affine, grain, x, y, t, ux, uy, sx, sy, spin):
    """Acceleration by the air's own (added mass), shear lift and spin lift: terms made of the air's gradients.

    (ux, uy) is the air's velocity, (sx, sy) that velocity less the granule's, in m/s; spin in rad/s.
    """
    xx, xy, yx, yy = gradient_at(affine, t)
    tx, ty = rise_at(affine, x, y, t) if grain[at.INERTIAL] != 0.0 else (0.0, 0.0)
    return forces_in_gradient(grain, xx, xy, yx, yy, tx, ty, ux, uy, sx, sy, spin)


@compiled
def forces_in_gradient(grain, xx, xy, yx, yy, tx, ty, ux, uy, sx, sy, spin):
    """The same from the gradient (du/dx, du/dy, dv/dx, dv/dy) of the air's velocity and its rate (tx, ty) in time."""
    fx = fy = 0.0
    if grain[at.INERTIAL] != 0.0:
        fx += grain[at.INERTIAL] * (tx + xx * ux + xy * uy)
        fy += grain[at.INERTIAL] * (ty + yx * ux + yy * uy)
    curl = yx - xy
    reynolds = math.sqrt(grain[at.REYNOLDS2] * (sx * sx + sy * sy))
    if grain[at.LIFT] != 0.0:
        lift = grain[at.LIFT] * lift_coefficient(reynolds, grain[at.VORTICITY] * abs(curl)) * curl
        fx += lift * sy
        fy -= lift * sx
    if grain[at.MAGNUS] != 0.0:
        turn = 0.5 * curl - spin
        lift = grain[at.MAGNUS] * turn
        if grain[at.SPIN_TORQUE] == 0.0:
            lift *= magnus_factor(reynolds, grain[at.VORTICITY] * abs(turn))
        fx -= lift * sy
        fy += lift * sx
    return fx, fy


@compiled
def free_force(affine, grain, table, x, y, vx, vy, t, spin):
    """Acceleration of a granule in free flight, the drag rate, and the air's velocity."""
    ux, uy, fx, fy = air_at(affine, x, y, t)
    sx, sy = ux - vx, uy - vy
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    fx += rate * sx
    fy += rate * sy
    if grain[at.EXTRA] != 0.0:
        ex, ey = gradient_forces(affine, grain, x, y, t, ux, uy, sx, sy, spin)
        fx += ex
        fy += ey
    return fx, fy, rate, ux, uy
