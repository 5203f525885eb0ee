"""The rungs: levels of airflow fidelity that a scene can ask for, listed once.

The scene's key ``numerics.rung``, the option ``--rung`` and the plan take their lists from here. A rung is a record:
what it computes is a kind of airflow (``air.kinds.airflow_kinds``), on grids of its own, to an accuracy of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.errors import SceneError
from ..core.registry import Registry, did_you_mean

GRIDS = 1.5  # refinement ratio between the grids of a study: three grids span 1.5^4 = 5 times the cells


@dataclass(frozen=True)
class Rung:
    """One level of airflow fidelity.

    ``meaning``: what it computes, in words. ``kind``: the kind of airflow, empty where the plan chooses another rung;
    ``kind_below_shedding``: the kind where the wake does not shed, empty for the same. ``scales``: cell edges over the
    usual ones of the kind, one a grid, from fine to coarse; the answer is that of the first, and in time each starts
    from the next. ``accuracy``: relative half width of the 95 % intervals of drag, base pressure and shedding frequency
    at which a time-resolved solution may end, 0 for the usual one. ``resolves``: the rung that resolves what this
    one leaves out where the wake sheds, empty where it leaves nothing out.
    """

    meaning: str
    kind: str
    kind_below_shedding: str = ""
    scales: tuple[float, ...] = (1.0,)
    accuracy: float = 0.0
    resolves: str = ""

    @property
    def needs_air(self) -> bool:
        """Whether the rung means nothing in a vacuum."""
        return self.kind not in ("", "none")


rungs: Registry[Rung] = Registry("rung")


def check_rung(name: str) -> None:
    """Raise SceneError, naming the nearest, for a rung that there is not."""
    if name not in rungs:
        raise SceneError(f"rung = {name!r}: unknown{did_you_mean(name, list(rungs))} (known: {', '.join(rungs)})")


rungs.add("auto", Rung("the rung that the Reynolds number and the accuracy asked for need", ""))
rungs.add("none", Rung("no air at all; the plan states what that leaves out", "none"))
rungs.add(
    "draft",
    Rung(
        "one steady solution: the flow itself below the onset of shedding; above, its wake is too long and its suction "
        "too weak",
        "steady",
        scales=(1.0, GRIDS),
        resolves="standard",
    ),
)
rungs.add(
    "standard",
    Rung(
        "time-resolved in two dimensions, started from a coarser mesh's: the flow itself up to the onset of "
        "three-dimensional motion; where the wake is turbulent, one of the two ends of the best estimate flown in",
        "time-resolved",
        scales=(1.0, GRIDS),
    ),
)
rungs.add(
    "reference",
    Rung(
        "the same on three grids, which give the error of the mesh; steady where the wake does not shed",
        "time-resolved",
        kind_below_shedding="steady",
        scales=(1 / GRIDS, 1.0, GRIDS),
        accuracy=0.005,  # below a third of what the grids differ by
    ),
)
rungs.add(
    "3d",
    Rung(
        "scale-resolving in three dimensions on a periodic span, 40 minutes (numerics.mesh_scale = 1.6) to three hours "
        "of one core a body: the wake breaks up as a real one does; steady where the wake does not shed",
        "three-dimensional",
        kind_below_shedding="steady",
    ),
)
