"""What the compiled kernel is handed, and where things are in its small state arrays.

One signature only: float64 and int64 arrays, C-contiguous, so that the kernel is compiled once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class PackedAir(NamedTuple):
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
    grid: Index  # (cells,) the triangle nearest to each cell of a regular grid, row by row; empty: no grid
    places: Array  # (5,) the grid's first corner, cells per m, cells in a row
    swing: Array  # (4,) amplitude, angular frequency, phase of the mesh, in whose frame granules fly; zeros: at rest
    even: Array  # (N,) s, for how long eddies stay what they are about there, see ``evenness``; empty: none asked for


class Walls(NamedTuple):
    """Bodies and lines. The outward normal is on the right of an edge, the solid on its left."""

    edges: Array  # (E, 7) start, end, outward normal, length
    edge_links: Index  # (E, 3) body, vertex at its start, vertex at its end (-1: none)
    vertices: Array  # (V, 2) convex corners and free ends
    vertex_links: Index  # (V, 3) body, edge that ends there, edge that starts there (-1: none)
    # (B, SAMPLES + 5 K) box at rest, largest displacement (x, y), angular frequency (0: at rest), phase, restitution,
    # friction (-1: the granule's), number of samples (0: harmonic), their period, largest angle of a body that rocks
    # (0: it is displaced) about a pivot (x, y), part of the impacts that it keeps; then of each sample time,
    # displacement, velocity, acceleration and its slope, over the largest displacement. With samples the frequency is
    # that of their fastest change, the phase a time (s)
    bodies: Array
    members: Index  # (B, 4) first and last + 1 part, closed, the line that what it keeps counts as
    parts: Array  # (P, 9) of the outlines, see ``walls.members_of``
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
    noise: float  # part of an eddy's lifetime and the response time over which a fluctuation is held
    noises: int  # intervals of noise that last as one: 1, or 2 along the same Brownian path
    seed: int  # of the random streams
    march: int  # 1: several triangles in one step where that is worth it
    left: float  # m, box about all bodies in all their places
    right: float
    bottom: float
    top: float
    steps: int
    impacts: int


# -- State of a granule: floats ----------------------------------------------------------------------------------------
(
    X, Y,  # m, place of its centre
    VX, VY,  # m/s
    SPIN,  # rad/s
    T,  # s, its clock
    T_END,  # s, when the loaded interval of the air ends
    H_ERROR,  # s, the step that the last error allows
    HELD,  # s, for how long friction or a wedge has held it
    BORN,  # s
    SEEN_X, SEEN_Y,  # the process of the fluctuation, of unit deviation
    MEAN_X, MEAN_Y,  # fluctuation of the air it sees over the deviation there, held over the interval of noise
    KICK_X, KICK_Y,  # m/s, Brownian velocity of the interval of noise
    T_NOISE,  # s, when the interval of noise ends
    H_STRIDE,  # s, the stride to try next; 0: none was tried
    GAIN_X, GAIN_Y,  # m/s, velocity that all but walls gave it since its birth; kept where its path is
    LAG,  # m/s, what each memory of the slip makes of it: x and y of the first, of the second ..
) = range(21)  # fmt: skip
MEMORIES = 7
FLOATS = LAG + 2 * MEMORIES

# -- State of a granule: integers --------------------------------------------------------------------------------------
(
    TRI,  # triangle that holds it
    STEPS,
    IMPACTS,
    FATE,
    LINE,  # that ended its track; -1: none
    CONTACT,  # kind of the feature it touches: FREE, ON_EDGE, ON_VERTEX
    FEATURE,  # which one
    GAP,  # covered boundary edge next to it, where it is in the room that a body has left; -1: it is in the mesh
    HOPS,  # crossings of edges in a row without progress
    STUCK,  # contacts in a row without progress
    SNAP_A, SNAP_B,  # snapshots around its clock, or the knots
    FRESH,  # 1: the air of its triangle and interval is loaded
    BODY,  # that it touches
    KEPT,  # points in its record
    KEEP_EVERY,  # one of so many points is kept
    OFFERED,  # points that could have been kept
    PATIENCE,  # confined steps before the next stride is tried
    STRIDES_REFUSED,  # in a row, at most 3
    EVALUATIONS,  # of the equation of motion
    DRAWS,  # random numbers used
    STREAM,  # of random numbers
    PAIR,  # kind of the other wall of a wedged granule, FREE: not wedged; in flight that of the wall last struck
    PAIRED,  # which one
) = range(24)  # fmt: skip
INTS = 24

# -- Constants of a granule. Accelerations are over 1 + chi with added mass --------------------------------------------
(
    STOKES,  # 1/s, drag rate of Stokes' law
    REYNOLDS2,  # (Re per m/s)^2
    RADIUS,  # m
    RESTITUTION,  # -1: by the law in the walls
    FRICTION,
    MOBILITY,  # m r^2 / I while it touches a wall; 0: it slides, as a flake does
    BLOW,  # the same in a blow
    TOSS,  # 1/m, rms spin that a normal impulse gives a flake; 0: no flake
    SECTION,  # m2, mean area of its projections over pi
    GIRTH,  # m, mean perimeter of its projections over 2 pi
    PRESSURE,  # acceleration per pressure gradient
    GX, GY,  # m/s2
    EXTRA,  # 1: one of the next three is on
    INERTIAL,  # of the air's acceleration Du/Dt
    LIFT,  # of shear lift: density ratio
    MAGNUS,  # of spin lift: 3/4 density ratio
    VORTICITY,  # Reynolds number of a rate of rotation of 1/s: rho d^2 / mu
    SPIN_RATE,  # 1/s, rate at which the air stops a slow spin
    SPIN_TORQUE,  # of the air on a flake that turns, W' = -c W |W|; 0: a ball
    NOISE,  # 1: dispersion or Brownian motion is on
    DISPERSION,  # 1: on
    DIFFUSIVITY,  # m2/s, Brownian
    SCATTER,  # rad, rms angle by which its shape turns the wall's normal at an impact
    GIVES_BACK,  # tangential restitution
    CAPTURE,  # m/s, of a slower normal approach to a wall ..
    STICKS,  # .. this part ends there
    FORGET,  # 1/s, over its own time, which its memories of the slip are given in; 0: no history force
    RECALL_0, RECALL_1, RECALL_2, RECALL_3, RECALL_4, RECALL_5, RECALL_6,  # 1/s, weights of the memories
) = range(35)  # fmt: skip
CONSTANTS = 35

# -- The path of a step, see ``dense_output`` --------------------------------------------------------------------------
(
    START_X, START_Y,  # m
    START_VX, START_VY,  # m/s
    RATE,  # 1/s, drag rate B, frozen at the start
    N0X, N0Y, N1X, N1Y, N2X, N2Y,  # m/s2, /s, /s^2: N = N0 + N1 s + N2 s^2
    AIR_X, AIR_Y,  # m/s, the air's velocity at the start
    MESH_X, MESH_Y,  # m, amplitude of a mesh that swings
    MESH_OMEGA,  # rad/s; 0: the mesh is at rest, or the granule in contact, and what follows has no meaning
    MESH_ANGLE,  # rad, of the swing at the start
    MESH_OUT_X, MESH_OUT_Y,  # m, displacement of the mesh there
    MESH_VX, MESH_VY,  # m/s, its velocity there
    SLIP,  # m/s, /s, /s^2: the slip where it is remembered, a parabola s0 + s1 s + s2 s^2: x and y of s0, s1, s2
) = range(22)  # fmt: skip
PAST = SLIP + 6  # m/s2, /s, /s^2: the history force that is part of N, the same
FADED_NEXT = PAST + 6  # which of the next is written next
FADED = FADED_NEXT + 1  # s, times of the step for which is kept how far the memories have faded: see ``history.faded``
FADED_TIMES, PER_FADED = 3, 1 + 3 * MEMORIES
PATH = FADED + FADED_TIMES * PER_FADED

# -- The air of one triangle and one interval of time, see ``air.load_triangle`` ---------------------------------------
# Polynomials in w = (t - T_BEGIN) PER_DT of the powers 0 to 3 (2 and 3 only where CUBIC is 1); each coefficient is
# affine: value at the origin, d/dx, d/dy. Power p of quantity m begins at U0 + PER_POWER p + PER_QUANTITY m, where the
# quantities are the velocity (u, v) and the acceleration by gravity and pressure (ax, ay).
ORIGIN_X, ORIGIN_Y, T_BEGIN, PER_DT, CUBIC = range(5)
SWING = 5  # four numbers: how the mesh swings, see SWING_X
PER_POWER, PER_QUANTITY = 12, 3
DX, DY = 1, 2  # from the value of a coefficient to its derivatives
U0, U0_X, U0_Y, V0, V0_X, V0_Y, AX0, AX0_X, AX0_Y, AY0, AY0_X, AY0_Y = range(9, 21)
U1, U1_X, U1_Y, V1, V1_X, V1_Y, AX1, AX1_X, AX1_Y, AY1, AY1_X, AY1_Y = range(21, 33)
U2, U2_X, U2_Y, V2, V2_X, V2_Y, AX2, AX2_X, AX2_Y, AY2, AY2_X, AY2_Y = range(33, 45)
U3, U3_X, U3_Y, V3, V3_X, V3_Y, AX3, AX3_X, AX3_Y, AY3, AY3_X, AY3_Y = range(45, 57)
AFFINE = 57

# -- Constraint of a granule in contact --------------------------------------------------------------------------------
(
    KIND,  # FREE, ON_EDGE, ON_VERTEX
    NX, NY,  # outward normal of an edge, as the body stood when it was taken
    OX, OY,  # m, start of the edge or the vertex
    ARM,  # m, radius of the granule
    MU,  # coefficient of friction
    SIGN,  # direction of slipping, 1 or -1; 0: held or rolling
    WX, WY, WW, WP,  # motion of the body: amplitude, angular frequency, phase
    ROLL,  # part of the tangential force that friction takes up while rolling; 0: sliding
    SAMPLED,  # 1: the body has samples, and these are the cubic at hand:
    W_BEGIN, W_END,  # s, when it begins and ends
    W_OUT, W_SPEED, W_PULL, W_JERK,  # there, over the largest displacement: displacement .. slope
    OTHER_NX, OTHER_NY,  # normal of the second wall of a wedged granule
    ROCKS, AT_X, AT_Y,  # rad and m, of a body that rocks: its largest angle and pivot
    LEANED,  # rad, its angle when the normals were taken
    TURNS,  # m, radius of a granule that rolls; 0: it slides
) = range(27)  # fmt: skip
CONSTRAINT = 27

# -- Columns of the tables of ``Air`` ----------------------------------------------------------------------------------
CORNER_X, CORNER_Y = 0, 1  # geometry: first corner
B0X, B0Y, B1X, B1Y, B2X, B2Y = range(2, 8)  # geometry: gradients of the barycentric coordinates; k's at B0X + 2 k
NODE_U, NODE_V, NODE_PX, NODE_PY, NODE_RMS, NODE_LIFE = range(6)  # values: as listed in ``Air``
COVER_TRI, COVER_EDGE, COVER_BEFORE, COVER_AFTER = range(4)  # covered
GRID_X, GRID_Y, PER_X, PER_Y, IN_ROW = range(5)  # places
KNOT_FIRST, KNOT_RATE, KNOT_COUNT = range(3)  # smooth
SWING_X, SWING_Y, SWING_OMEGA, SWING_PHASE = range(4)  # swing, and the block SWING of the loaded air

# -- Columns of the tables of ``Walls`` --------------------------------------------------------------------------------
FROM_X, FROM_Y, TO_X, TO_Y, OUT_X, OUT_Y, LENGTH = range(7)  # edges; lines have the first four
OWNER, BEFORE, AFTER = range(3)  # edge_links and vertex_links: body, feature before and after along the outline
VERTEX_X, VERTEX_Y = 0, 1  # vertices
FIRST_PART, LAST_PART, CLOSED, COUNTS_AS = range(4)  # members; LAST is one beyond
LOW_X, LOW_Y, HIGH_X, HIGH_Y, REACH_X, REACH_Y, OMEGA, PHASE = range(8)  # bodies and frame
# parts: a box, as that of a body, the edges and vertices in it, and the next part that is none of its own
FIRST_EDGE, LAST_EDGE, FIRST_VERTEX, LAST_VERTEX, BEYOND = range(4, 9)
BODY_RESTITUTION, BODY_FRICTION, SAMPLE_COUNT, SAMPLE_PERIOD, ROCK, PIVOT_X, PIVOT_Y, KEEPS = range(8, 16)
SAMPLES = 16  # bodies: the first sample's time; sample i's at SAMPLES + PER_SAMPLE i, and from there on
PER_SAMPLE = 5
SAMPLE_OUT, SAMPLE_SPEED, SAMPLE_PULL, SAMPLE_JERK = range(1, 5)
# restitution: where a cell begins, 1 / its width, coefficients of its cubic
CELL_BEGIN, CELL_PER, CELL_0, CELL_1, CELL_2, CELL_3 = range(6)

# -- A record: points of a track ---------------------------------------------------------------------------------------
REC_T, REC_X, REC_Y, REC_VX, REC_VY, REC_GAIN_X, REC_GAIN_Y = range(7)
RECORD = 7

# -- Kinds and fates ---------------------------------------------------------------------------------------------------
# numpy scalars: numba would compile every helper anew for each literal int it is called with
FREE: Any = np.int64(0)
ON_EDGE: Any = np.int64(1)
ON_VERTEX: Any = np.int64(2)
NOBODY: Any = np.int64(-1)
FLYING = -1
BINNED, ESCAPED, RESTING, CAPTURED, AIRBORNE, STOPPED = range(6)

# -- Bounces -----------------------------------------------------------------------------------------------------------
SLOW = 1e-6  # m/s, rebounds slower than this are sliding
LOWEST_BOUNCE = 0.01  # of the landing error asked for: bounces that rise less are sliding, which it does not notice
MAX_IMPACTS = 5_000  # a granule that rattles in a notch of a vibrating body would go on for good
