"""Flakes: thin rigid plates (chaff, glumes, husks) and stems. What a blow makes of their spin, how the air stops it and
lifts them, and the section with which they meet others.

A ball is turned by friction alone, all in one sense. A plate of random orientation is struck at a corner: the normal
impulse, with a lever of a part of its length, throws it into a spin of either sense, and friction adds a small mean.
With J_n and J_t the impulses per mass (m/s) of its centre, which goes as a disc's, c = sqrt(L B) of length and width,
and xi a standard normal number, the spin about the axis across the picture changes by

    (SPREAD J_n xi - TURN J_t) / c.

Both numbers are those of rigid plates that were thrown on slopes of 30 to 60 degrees and followed through all their
blows (``tests/proofs/studies flakes``, docs/model.md): mean and standard deviation of that component, the axis being
any. TURN is 0.63 to 0.88, of stems 1.1 to 1.5; SPREAD 0.25 at 30, 0.4 to 0.6 at 45 and 0.6 at 60 degrees. Energy does
not grow: that of a rod as long as c, c^2 W^2 / 24 over the mass (Routh 1897), gains no more than the blow has freed.

Two convex bodies of random orientation meet with the mean section A1 + A2 + P1 P2 / (2 pi), with A the mean area and P
the mean perimeter of a projection (Santalo, L.A. 1976, Integral Geometry and Geometric Probability, ch. 15, of Steiner
and Cauchy: A is a quarter of the surface, P pi times the mean width). Of two balls it is pi (r1 + r2)^2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TURN, SPREAD = 0.75, 0.45  # of plates thrown on slopes
ROD = 12.0  # m L^2 / I of a rod about its middle
POWER = 1.6075  # of means over the axes of an ellipsoid
BROADSIDE = 1.2  # drag coefficient of a plate across the stream
CIRCULATION = 1.0  # C_R


def flung(spin: Array, toss: Array, normal: Array, along: Array, freed: Array, xi: Array) -> Array:
    """Spin (rad/s) of a plate after a blow, from its ``spin`` before.

    ``toss`` = SPREAD / c (1/m), ``normal`` and ``along`` impulses per mass (m/s; along the tangent z x n), ``freed``
    |v|^2 before less after (m2/s2, seen from the wall), ``xi`` standard normal. Arrays, or scalars in the kernel.
    """
    most = np.sqrt(spin * spin + ROD / (SPREAD * SPREAD) * toss * toss * np.maximum(freed, 0.0))
    return np.minimum(np.maximum(spin + toss * (normal * xi - TURN / SPREAD * along), -most), most)


def shape_of(dimensions: Sequence[float], *, flake: bool) -> Array:
    """Length, width and thickness (m) over the diameter of the ball of the volume of the box (flakes) or ellipsoid."""
    volume = math.prod(dimensions) * (6.0 / math.pi if flake else 1.0)
    return np.array(dimensions, dtype=float) / float(volume ** (1.0 / 3.0))


def section(shape: Array, flake: Array) -> tuple[Array, Array]:
    """A over pi r^2 and P over 2 pi r (n,) of bodies with length, width, thickness ``shape`` (n, 3) over the diameter
    2 r of their equal ball: boxes where ``flake`` (n,), ellipsoids elsewhere.

    Ellipsoids by Thomsen's mean over the products of axes (Klamkin, M.S. 1971, Am. Math. Monthly 78, 280, of such
    means), within 1.1 %; the mean width is the surface of the ellipsoid of inverse axes: the same mean of the axes.
    """
    products = shape * np.roll(shape, 1, axis=1)
    surface, width = (np.mean(of**POWER, axis=1) ** (1.0 / POWER) for of in (products, shape))
    box = 2.0 * products.sum(axis=1) / math.pi, 0.5 * shape.sum(axis=1)
    return np.where(flake, box[0], surface), np.where(flake, box[1], width)


def plate_torque(shape: Array, ratio: Array) -> Array:
    """c of a plate's spin in still air, W' = -c W |W|: 3/16 C_D (rho / rho_p) L / T, by the pressure on its halves.

    A strip at x moves with W x: the torque is rho C_D B W^2 L^4 / 64, the moment of inertia rho_p T B L^3 / 12. C_D =
    1.2 (Hoerner, S.F. 1965, Fluid-Dynamic Drag, ch. 3: plates across the stream 1.1 to 1.2). ``ratio`` rho / rho_p.
    """
    return 3.0 / 16.0 * BROADSIDE * ratio * shape[:, 0] / shape[:, 2]


def plate_lift(shape: Array, ratio: Array) -> Array:
    """Lift of a plate that turns, over W x s: C_R (rho / rho_p) e / (2 T), C_R = 1, e = (L B / (B + 2 L) + L B / (L + 2
    B)) / 2.

    The circulation of a wide plate that turns is C_R c^2 W / 2 on the chord c; it outweighs that of its angle to the
    stream (Andersen, A., Pesavento, U. & Wang, Z.J. 2005, J. Fluid Mech. 541, 65, Re 1e3). C_R is of order one. A span
    b leaves b / (b + 2 c) of it (Prandtl's lifting line); e is the mean over chords along L and along B. ``ratio`` rho
    / rho_p.
    """
    long, wide, thick = shape.T
    chord = 0.5 * long * wide * (1.0 / (wide + 2.0 * long) + 1.0 / (long + 2.0 * wide))
    lift: Array = 0.5 * CIRCULATION * ratio * chord / thick
    return lift
