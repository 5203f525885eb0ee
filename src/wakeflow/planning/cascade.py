"""Bodies one below the other: which of them granules of one can come to, and which lie in the wake of one.

Both are bounds for a plan to tell. A run computes every impact on every body, and the air of all bodies together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import permutations

import numpy as np

from ..core.quantities import metres
from ..laws.far_wake import DRAG, apart, slower_behind
from ..scene import Scene
from .collision_rates import ejection_speed
from .uniform_fall import Array


def cascade_lines(scene: Scene, *, blown: bool) -> Iterator[str]:
    """A line for each body that granules of one above can come to, and for each that the wake of another reaches, with
    how much slower its air is at most; ``blown``: granules fly in air that moves.
    """
    seen = {name: scene.plumb.seen(body.outline()) for name, body in scene.body.items()}
    for lower, under in seen.items():
        above = [name for name, one in seen.items() if one[:, 1].mean() > under[:, 1].mean()]
        throws = {name: [_thrown(scene, kind, seen[name], under) for kind in scene.fraction] for name in above}
        feed = [name for name in above if max(throws[name]) > apart(seen[name], under)]
        if feed:
            far = zip(scene.fraction, np.max([throws[name] for name in feed], axis=0), strict=True)
            thrown = ", ".join(f"{kind} {metres(float(reach), 2)}" for kind, reach in far)
            yield f"cascade: {lower} is met by what leaves {', '.join(feed)}, thrown up to ({thrown}) aside"
    along = -1.0 if scene.air is not None and scene.air.direction == "down" else 1.0
    outlines = {name: body.outline() for name, body in scene.body.items()} if blown else {}
    for front, behind in permutations(outlines, 2):
        slower = slower_behind(outlines[front], outlines[behind], along)
        if slower > 0.0:
            yield (
                f"wake: that of {front} reaches {behind}, with air up to {100.0 * slower:.0f} % slower (a far wake at "
                f"Cd {DRAG:g}); both are in one airflow"
            )


def _thrown(scene: Scene, name: str, upper: Array, lower: Array) -> float:
    """How far (m) aside granules of a fraction come at most that fall from their release onto the ``upper`` outline,
    before they are past the ``lower`` one: without air, thrown up as fast as aside from the upper one's top.
    """
    above, start = scene.release
    top = float(upper[:, 1].max())
    arrival = math.sqrt(start**2 + 2.0 * scene.gravity * max(0.0, scene.level + above - float(upper[:, 1].min())))
    aside = ejection_speed(scene, scene.fraction[name], arrival) * arrival
    drop = top - float(lower[:, 1].min())
    return aside * (aside + math.sqrt(aside**2 + 2.0 * scene.gravity * drop)) / scene.gravity
