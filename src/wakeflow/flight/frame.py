"""The frame of a mesh that swings: granules fly in it, so that the mesh and the body it moves with stand still.

With the mesh displaced by d(t), y = x - d and w = v - d' obey the same equation with the air's velocity u(y, t) - d'
and gravity g - d'': slips, drag and Du/Dt are what they are in the lab, and nothing is approximated. Bodies and bins
that rest in the lab move by -d.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..air.field import FlowField, MeshOscillation
from ..core.errors import SceneError
from .bodies import Body
from .granules import Granules

Array = NDArray[np.float64]
SAME = 1e-9  # relative difference of frequencies and phases that counts as none
MINUTE = 1e-9  # of an amplitude: relative motion below it is round-off


def mesh_motion_of(field: FlowField | None) -> MeshOscillation | None:
    """How the field's mesh moves; None at rest."""
    swing = None if field is None else field.motion
    return None if swing is None or (swing.x == 0.0 and swing.y == 0.0) else swing


def relative(body: Body | None, swing: MeshOscillation | None) -> list[float]:
    """Amplitude (x, y), angular frequency and phase of a body's motion seen from the mesh; zeros for none.

    Of one that rocks: its largest displacement. Of samples: the largest displacement, the pace of their fastest change,
    and the phase as a time (s). Raises SceneError for a body that vibrates otherwise than the mesh: about a pivot, with
    another frequency or phase, or by samples.
    """
    own, motion = [0.0] * 4, None if body is None else body.motion
    if body is not None and motion is not None and motion.moves:
        amplitude = np.asarray(motion.amplitude) if motion.pivot is None else body.reach
        own = [*amplitude.tolist(), motion.pace, float(motion.phase)]
        if motion.record is not None:
            own[3] *= motion.record.period / (2 * math.pi)
    if swing is None:
        return own
    if motion is not None and motion.moves and motion.pivot is not None:
        raise SceneError(
            "bodies: one rocks about a pivot, the field's mesh vibrates; they must agree, or the body rest"
        )
    if motion is not None and motion.record is not None:
        raise SceneError("bodies: one moves by samples, the field's mesh vibrates; they must agree, or the body rest")
    if own[2] != 0.0:
        lag = (own[3] - swing.phase + math.pi) % (2 * math.pi) - math.pi
        if abs(own[2] - swing.omega) > SAME * swing.omega or abs(lag) > SAME:
            raise SceneError(
                f"bodies: one vibrates at {own[2] / (2 * math.pi):g} Hz, phase {own[3]:g}, the field's mesh at "
                f"{swing.omega / (2 * math.pi):g} Hz, phase {swing.phase:g}: they must agree, or the body rest"
            )
    x, y = own[0] - swing.x, own[1] - swing.y
    if math.hypot(x, y) <= MINUTE * math.hypot(swing.x, swing.y):
        return [0.0] * 4
    return [x, y, swing.omega, swing.phase]


def to_frame(grains: Granules, swing: MeshOscillation | None) -> Granules:
    """Granules at birth as seen from the mesh."""
    if swing is None:
        return grains
    t, pace = grains.time, swing.velocity(grains.time)
    came = None if grains.arrival is None else grains.arrival - pace
    return grains.replace(
        position=grains.position - swing.displacement(t), velocity=grains.velocity - pace, arrival=came
    )


def from_frame(position: Any, velocity: Any, time: Any, swing: MeshOscillation | None) -> tuple[Array, Array]:
    """Positions and velocities (n, 2) at times (n,) back in the lab."""
    if swing is None:
        return position, velocity
    return position + swing.displacement(time), velocity + swing.velocity(time)
