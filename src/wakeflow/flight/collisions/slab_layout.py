"""What the compiled kernel of collisions keeps of a granule beside the tracker's own state (``kernel.layout``)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernel.layout import MEMORIES

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# -- State of a granule beyond the tracker's ---------------------------------------------------------------------------
(
    Z, VZ,  # m, m/s: across the slab
    WX, WY,  # rad/s, spin about the axes in the plane
    LIGHT,  # 1/kg, inverse mass
    ROOM,  # m that it may go before a wall or line can be near; used up by what it goes
    DRAG,  # 1/s, drag rate of its last piece of way; 0: none yet, or a strike since
    TOUCHED,  # HELD_BY_WALL, or TOUCHES_OTHERS at the end of the step; 0: free
    MET,  # meetings in this step
    LEG_BEGIN, LEG_END,  # s of the step: its last piece without a strike on a wall, on which it can be met
    LEG_X, LEG_Y, LEG_Z,  # m, where that piece begins
    LEG_VX, LEG_VY, LEG_VZ,  # m/s
    LEG_AX, LEG_AY, LEG_AZ,  # m/s2: the parabola through its beginning, the velocity there and its end
    LEG_WX, LEG_WY, LEG_WZ,  # rad/s, its spin at the beginning
    LEG_GAIN_X, LEG_GAIN_Y,  # m/s, what all but walls and others had given it by then
    PULL_Z,  # m/s2 across the slab in its last piece of way, beside drag
    SINCE,  # s: when that piece began, and
    SLIP_X, SLIP_Y, SLIP_Z,  # m/s, its slip, which the memories of the history force have not seen yet
    LAG_Z,  # m/s: what each memory makes of the slip across the slab; those of the plane are in the tracker's state
) = range(31)  # fmt: skip
EXTRAS = LAG_Z + MEMORIES

LOOSE, HELD_BY_WALL, TOUCHES_OTHERS = 0.0, 1.0, 2.0

# -- Whole numbers of a granule beyond the tracker's -------------------------------------------------------------------
(
    MEETINGS,
    STAMP,  # counts its pieces: foretold meetings with another stamp are void
    FRACTION,  # a row of the laws
    TRACER,  # 1: it is hit, and hits nothing
    PARTNER,  # slot of the granule that it met last, -1: none
    MET_IN,  # the step of that
) = range(6)
TALLY = 6

# -- The clock and what all granules share in a step ---------------------------------------------------------------
(
    NOW,  # s, when the step begins
    UNTIL,  # s, when it ends
    STEP,  # s
    OUT_X, OUT_Y,  # m, displacement of a mesh that swings, in the middle of the step
    DEPTH,  # m, of the slab
    WIDTH,  # m, of a cell
    AHEAD,  # steps for which a range is meant
    MOST,  # m, radius of the largest range
    ROWS,  # cells across the slab
    PULL,  # m/s2, the largest acceleration by gravity
) = range(11)  # fmt: skip
CLOCK = 11

# -- Counters ----------------------------------------------------------------------------------------------------------
(
    LIVING,  # granules in flight or at rest: entries of ``living``
    BORN,  # entries of ``waiting`` that have been born
    STEPS,  # of the clock, taken so far
    FLOWN,  # steps of granules, taken so far
    STANDING,  # granules that lie still
    EVENTS,  # foretold meetings in the queue
    NEAR,  # pairs that touch or may touch at the end of the step
    LEANING,  # granules that lie still, or lean on others and hardly move
    MASK,  # buckets of the hash in use, less one
    PAIRS,  # whose ranges touch: entries of ``Cells.pairs``
    FULL,  # 1: there was no room for one more
    ANEW,  # the step in which cells are made anew
) = range(12)  # fmt: skip
COUNTS = 12

# -- A pair ------------------------------------------------------------------------------------------------------------
FIRST, SECOND, FIRST_STAMP, SECOND_STAMP = range(4)
EVENT = 4

# -- The ball that holds a granule on its way in the step --------------------------------------------------------------
BALL_X, BALL_Y, BALL_Z, BALL = range(4)  # m: centre and radius
SPARE_BALL = 1e-6  # of its radius: more than round-off, and than contact reaches


class Colliding(NamedTuple):
    """The granules of a slab by slot, in the rows that the tracker's kernel uses, and those of collisions."""

    states: Array  # (S, FLOATS)
    counts: Index  # (S, INTS)
    grains: Array  # (S, CONSTANTS)
    table_of: Index  # (S,)
    extra: Array  # (S, EXTRAS)
    tally: Index  # (S, TALLY)
    records: Array  # (S, points, RECORD)
    living: Index  # (S,) slots, in the order of birth
    waiting: Index  # (W,) slots of granules to be born, in that order


class Laws(NamedTuple):
    """What granules do to each other, by fractions (k, k), and the drag tables."""

    restitution: Array
    friction: Array
    tangential: Array
    tables: Array  # (k, cells, 4)


class Nodes(NamedTuple):
    """The air at the nodes in the middle of the step. One that changes in time is brought there where it is read."""

    now: Array  # (N, C)
    rates: Array  # (N, 2) m/s2, of the velocity; (0, 2) where nothing needs them
    looked: Index  # (N,) the step in which a node was brought to its middle
    when: Index  # (3,): THIS_STEP, BEFORE, AFTER
    weights: Array  # (8,) of the four coefficients (two snapshots) about the middle, for the value and for its rate


THIS_STEP, BEFORE, AFTER = range(3)
RATES = 4  # of ``weights``: where those for the rate begin


class Cells(NamedTuple):
    """Neighbours: ranges in the buckets of a hash of cells, pairs whose ranges touch; the queue of foretold meetings
    and the pairs that touch.
    """

    balls: Array  # (S, 4)
    ranges: Array  # (S, 4); radius 0: not listed
    where: Index  # (S, 3) cell of the range
    stamps: Index  # (S,) counts how often a slot was listed
    heads: Index  # (2^k,) last granule put into each bucket, -1: none
    next: Index  # (S,) granule put into the same bucket before, -1: none
    pairs: Index  # (L, EVENT)
    when: Array  # (Q,) s of the step
    who: Index  # (Q, EVENT)
    near: Index  # (P, 2)


class Room(NamedTuple):
    """Scratch of one thread."""

    path: Array
    affine: Array
    hold: Array
    air_state: Array  # (FLOATS,) and (INTS,): the clock of the air alone
    air_ints: Index
    kept_state: Array  # (FLOATS,), (INTS,) and (EXTRAS,): a granule while a tracer looks where it was
    kept_ints: Index
    kept_extra: Array
    struck: Index  # (2,) slots of those that have met, and fly the rest of the step
