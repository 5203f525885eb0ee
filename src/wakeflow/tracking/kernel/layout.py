"""What the compiled kernel is handed, and where things stand in its small state arrays.

One signature only: float64 and int64 arrays, C-contiguous, so that the kernel is compiled once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Air", "Rules", "Walls"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Air(NamedTuple):
    """The field. Without one, ``corners`` is empty."""

    geometry: Array  # (M, 8) first corner, gradients of the three barycentric coordinates
    corners: Index  # (M, 3)
    neighbours: Index  # (M, 3): triangle across edge k; -1 open boundary; -2 - c: covered boundary edge c
    # (T, N, 2) velocity, (T, N, 4) with the pressure gradient, (T, N, 6) with deviation and lifetime of the eddies; of
    # a smooth field (N, knots + 3, ..): coefficients of periodic cubic B-splines, from the last knot's on
    values: Array
    times: Array  # (T,)
    period: Array  # (1,) s; 0: does not repeat
    covered: Index  # (C, 4) triangle, its edge, previous and next covered edge along the boundary (-1: none)
    smooth: Array  # (3,) first knot, knots per s, number of knots; zeros: not smooth
    swing: Array  # (4,) amplitude, angular frequency, phase of the mesh, in whose frame granules fly; zeros: at rest


class Walls(NamedTuple):
    """Bodies and lines. The outward normal is on the right of an edge, the solid on its left."""

    edges: Array  # (E, 7) start, end, outward normal, length
    edge_links: Index  # (E, 3) body, vertex at its start, vertex at its end (-1: none)
    vertices: Array  # (V, 2) convex corners and free ends
    vertex_links: Index  # (V, 3) body, edge that ends there, edge that starts there (-1: none)
    # (B, SAMPLES + 5 K) box at rest, largest displacement (x, y), angular frequency (0: at rest), phase, restitution,
    # friction (-1: the granule's), number of samples (0: harmonic), their period; then of each sample time,
    # displacement, velocity, acceleration and its slope, over the largest displacement. With samples the frequency is
    # that of their fastest change, the phase a time (s)
    bodies: Array
    members: Index  # (B, 6) first and last + 1 edge, first and last + 1 vertex, closed, captures
    lines: Array  # (K, 4)
    line_ids: Index  # (K,)
    frame: Array  # (1, SAMPLES) as one of the bodies: how the lines move in the mesh's frame
    restitution: Array  # (C, 6) cells of the granules' restitution law, see ``restitution_table``; (0, 6): numbers


class Rules(NamedTuple):
    """Scalars of one call."""

    until: float
    allowance: float  # position error allowed per metre of path
    extent: float  # m, scale of a flight
    length: float  # m, scale of a body
    skin: float  # m, distances below it are contact
    tiny: float  # m, bounces lower than this are sliding
    rest: float  # s, a granule held this long in a repeating field rests
    coarse: float  # s, a longer step between looks at a field that changes in time would miss how it does
    shaken: float  # m/s2, largest acceleration of the mesh
    noise: float  # part of an eddy's lifetime over which a fluctuation's mean is drawn
    seed: int  # of the random streams
    march: int  # 1: several triangles in one go where that is worth it
    left: float  # m, box about all bodies in all their places
    right: float
    bottom: float
    top: float
    steps: int
    impacts: int


# Float state of a granule; SEEN: fluctuation of the air it sees over the deviation there, at the end of the interval
# (SEEN) and its mean over it (MEAN); KICK: Brownian velocity of the interval, which ends at T_NOISE
(
    X,
    Y,
    VX,
    VY,
    TURN,
    T,
    T_END,
    H_ERROR,
    HELD,
    BORN,
    SEEN_X,
    SEEN_Y,
    MEAN_X,
    MEAN_Y,
    KICK_X,
    KICK_Y,
    T_NOISE,
    H_STRIDE,
) = range(18)
FLOATS = 18
# Integer state
(
    TRI,
    STEPS,
    IMPACTS,
    FATE,
    LINE,
    CONTACT,
    FEATURE,
    GAP,
    HOPS,
    STUCK,
    SNAP_A,
    SNAP_B,
    FRESH,
    BODY,
    STORED,
    STRIDE,
    SEEN,
    PATIENCE,
    REFUSED,
    QUADRATIC,
    UNSTRIDDEN,
    EVALUATIONS,
    DRAWS,
    STREAM,
    PAIR,  # kind of the other wall of a wedged granule, FREE: not wedged; in flight that of the wall last struck
    PAIRED,  # which one
) = range(26)
INTS = 26
# Constants of a granule. Accelerations are over 1 + chi with added mass; those of terms that are off are zero.
(
    STOKES,  # 1/s, drag rate of Stokes' law
    REYNOLDS2,  # (Re per m/s)^2
    RADIUS,
    RESTITUTION,  # -1: by the law in the walls
    FRICTION,
    MOBILITY,  # m r^2 / I
    PRESSURE,  # acceleration per pressure gradient
    GX,
    GY,
    EXTRA,  # 1: one of the next three is on
    INERTIAL,  # of the air's acceleration Du/Dt
    LIFT,  # of shear lift: density ratio
    MAGNUS,  # of spin lift: 3/4 density ratio
    VORTICITY,  # Reynolds number of a rate of rotation of 1/s: rho d^2 / mu
    SPIN,  # 1/s, rate at which the air stops a slow spin
    NOISE,  # 1: dispersion or Brownian motion is on
    DISPERSION,  # 1: on
    DIFFUSIVITY,  # m2/s, Brownian
) = range(18)
CONSTANTS = 18
# x, y | u, v, ax, ay, each as value, d/dx, d/dy | t, 1/dt | the same twelve as coefficients of w = (now - t) / dt, of
# its square and its cube, these only where CUBIC is 1 | swing of the mesh
CUBIC, SWING = 52, 53
AFFINE = 57
# Constraint of a granule in contact: kind, normal, origin, radius, friction, direction of sliding, motion of the body,
# part of the tangential force that friction takes up while rolling (0: sliding); of a body with samples (SAMPLED 1) the
# cubic at hand: when it began and ends, its displacement, velocity, acceleration and slope at the beginning; normal of
# the second wall of a wedged granule
(
    KIND, NX, NY, OX, OY, ARM, MU, SIGN, WX, WY, WW, WP, ROLL, SAMPLED, W_BEGIN, W_END, W_OUT, W_SPEED, W_PULL, W_JERK,
    N2X, N2Y,
) = range(22)  # fmt: skip
CONSTRAINT = 22
MOTION, SAMPLES = 10, 12  # columns of a body: where its samples' number and period stand, and the first sample
# numpy scalars: numba would compile every helper anew for each literal int it is called with
FREE: Any = np.int64(0)
ON_EDGE: Any = np.int64(1)
ON_VERTEX: Any = np.int64(2)
NOBODY: Any = np.int64(-1)
FLYING = -1
BINNED, ESCAPED, RESTING, CAPTURED, AIRBORNE, STOPPED = range(6)
# shared with the chain (wakeflow.ballistics), so that both follow the same bounces
SLOW = 1e-6  # m/s, rebounds slower than this are sliding
MOST_IMPACTS = 5_000  # a granule that rattles in a notch of a vibrating body would go on for good
