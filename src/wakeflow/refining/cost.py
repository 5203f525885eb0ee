"""What a round would cost, from the run times of a finished one."""

from __future__ import annotations

from collections.abc import Mapping
from math import log

from ..budget.steps import FINER, FINER_STEPS
from ..pipeline.stages import StageTime
from ..planning.plan import COMPARED, REPLICATES
from ..planning.stages import Scaling, StageKey
from ..results.refinement import KnobSettings

OVERHEAD = 0.4  # s of a stage in which granules fly, however few they are
LEAST_POWER, MOST_POWER = 0.02, 0.34  # of a flight's time with its tolerance: from one step a cell to order three


def expected_seconds(spent: Mapping[str, StageTime], now: KnobSettings, then: KnobSettings) -> float:
    """Run time (s) of a round with the settings ``then``, from what the stages of one with those of ``now`` took."""
    if then == now:
        return 0.0
    slab_only = all(getattr(then, key) == getattr(now, key) for key in ("granules", "tolerance", "mesh_scale"))
    same_air = (then.mesh_scale, then.averaging) == (now.mesh_scale, now.averaging)
    power, whole = _power(spent), 0.0
    for name, stage in spent.items():
        match StageKey.of(name).stage.scaling:
            case Scaling.AIR | Scaling.CELLS as scaling:
                whole += 0.0 if same_air else stage.seconds * _air_factor(scaling, now, then)
            case Scaling.SLAB:
                whole += stage.seconds * (then.slab or 1) / (now.slab or 1)
            case Scaling.FLIGHTS if not (slab_only and same_air):
                whole += OVERHEAD + max(0.0, stage.seconds - OVERHEAD) * _flight_factor(power, now, then)
    return whole


def _air_factor(scaling: Scaling, now: KnobSettings, then: KnobSettings) -> float:
    """Steps go with the cells' edges, averages with the square of what they are known to."""
    finer = (now.mesh_scale or 1.0) / (then.mesh_scale or 1.0)
    longer = (now.averaging or 1.0) / (then.averaging or 1.0)
    return float(finer**2 if scaling is Scaling.CELLS else finer**3 * longer**2)


def _flight_factor(power: float, now: KnobSettings, then: KnobSettings) -> float:
    crossed = (now.mesh_scale or 1.0) / (then.mesh_scale or 1.0)  # cells on a granule's way
    return float(then.granules / now.granules * (now.tolerance / then.tolerance) ** power * crossed)


def _power(spent: Mapping[str, StageTime]) -> float:
    """Of a flight's time with its tolerance, as the companion with finer steps shows it."""
    own, finer = spent.get("tracks"), spent.get(FINER_STEPS)
    if own is None or finer is None or min(own.seconds, finer.seconds) <= 2.0 * OVERHEAD:
        return LEAST_POWER
    slower = finer.seconds / own.seconds * REPLICATES / COMPARED
    return min(max(log(max(slower, 1.0)) / log(1.0 / FINER), LEAST_POWER), MOST_POWER)
