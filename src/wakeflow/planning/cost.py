"""What a plan will cost: the seconds of each stage, memory and disk, before anything is started.

All numbers are measured: runs of the shipped scenes on two cores of 2020s hardware. What this machine makes of the
seconds is in :mod:`.machine_rates`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ..funnel import estimated_seconds
from ..laws.forces import forces
from ..scene import Scene
from .airflow import AirflowPlan
from .airflow_cost import solver_seconds, span_cost, typical_cells
from .crowd import CrowdPlan
from .flights_again import times_again
from .plan import AT_ONCE, COMPARED, DRAWS, GATHERED, REPLICATES, CostEstimate, FractionPlan, StageCost, replicate_size

__all__ = ["AirflowCost", "airflow_cost", "estimate_cost", "expected_stages", "wall_seconds"]

STARTED = 2.0  # s: importing and planning
REPORT = 4.0  # s: its figures, tables and the field's files
SECONDS_A_GRANULE = 450e-6  # s of both cores past a body: one flight with drag and weight; dispersion doubles it
IN_KNOWN_AIR = 120e-6  # s of both cores: the same in air that is known without triangles
BY_CHAIN = 30e-6  # s of both cores: of a flight from impact to impact without air
EACH_STAGE = 0.5  # s of a stage in which granules fly, however few they are
MESHED = 0.5, 3.0e-4  # s of a mesh, and of each cell
READ = {"steady": 1.0, "time-resolved": 4.5}  # s: the field of a solved airflow
DRAWN = 0.05  # s: to draw the granules of a fraction anew, and its air
PASSES, AGAIN_UNDER_FORCE = 3, 0.5  # of the air that feels the granules; a solution under force over a first one
RESIDENCE = 5.0  # s
PROGRAM = 4e8  # bytes: the interpreter with its libraries, and a field
BYTES_IN_FLIGHT = 1500.0  # bytes of memory a granule that is fed and flown at the time
BYTES_LANDED = 120.0  # bytes of memory a granule: its row of landings
FILES = 1e6  # bytes: tables and report
BYTES_A_CELL = 1500.0  # bytes of disk a cell: the mesh in text
BYTES_A_SNAPSHOT = 80.0  # bytes of disk a cell and snapshot: its fields
SNAPSHOTS = {"time-resolved": 150.0, "steady": 2.0}  # number kept of an airflow
SLAB_AGAIN = {"slab longer steps": 0.18, "thinner slab": 0.14}  # of the slab's time: part of it with one thing changed
SLAB_IN_KNOWN_AIR = 0.25  # of its time in air on triangles
BYTES_STORED = 80.0  # bytes of disk a granule and fraction: its row of landings, compressed


class AirflowCost(NamedTuple):
    """What an airflow alone costs: ``seconds``, and bytes of ``disk``."""

    seconds: float
    disk: float


def airflow_cost(scene: Scene, airflow: AirflowPlan) -> AirflowCost:
    """What is shared by all scenes that fly in one airflow."""
    cells, deep = typical_cells(scene, airflow), span_cost(scene, airflow)
    kept = 0.0 if airflow.span is not None else BYTES_A_SNAPSHOT * SNAPSHOTS[airflow.stepping or "steady"]
    seconds = sum(stage.whole for stage in _airflow_stages(scene, airflow))
    return AirflowCost(seconds, cells * (BYTES_A_CELL + kept) + deep.disk)


def estimate_cost(
    scene: Scene, airflow: AirflowPlan, fractions: Mapping[str, FractionPlan], stages: Sequence[StageCost]
) -> CostEstimate:
    """What a run of these ``stages`` costs."""
    count = _fed(scene)
    at_once = max(min(count, AT_ONCE), count // REPLICATES)
    air, deep = airflow_cost(scene, airflow), span_cost(scene, airflow)
    return CostEstimate(
        seconds=wall_seconds(stages),
        memory=max(PROGRAM + BYTES_IN_FLIGHT * at_once + BYTES_LANDED * count, deep.memory),
        disk=FILES + air.disk + BYTES_STORED * count * len(fractions),
    )


def wall_seconds(stages: Sequence[StageCost], cores: int = 2) -> float:
    """Seconds until the last of ``stages`` is done. What does not need the answer's own airflow is made beside it, on
    another core where there is one.
    """
    spent = dict.fromkeys(StageCost.ORDER, 0.0)
    for stage in stages:
        spent[stage.when] += stage.whole
    together = (max if cores > 1 else sum)((spent["answer"], spent["beside"]))
    return STARTED + spent["first"] + together + spent["after"]


def expected_stages(
    scene: Scene, airflow: AirflowPlan, fractions: Mapping[str, FractionPlan], crowd: CrowdPlan | None
) -> tuple[StageCost, ...]:
    """The stages of a run by the names that its listener hears, in the order in which they are usually done."""
    found = []
    if scene.funnel is not None:
        found.append(StageCost("funnel", estimated_seconds(scene.funnel), "first"))
    found += _airflow_stages(scene, airflow)
    if airflow.loaded:
        found += _loading_stages(scene, airflow, fractions)
    found.append(StageCost("tracks", _flown(airflow, fractions, _fed(scene)), "after"))
    if crowd is not None:
        slab = crowd.seconds * (SLAB_IN_KNOWN_AIR if airflow.kind == "analytic" else 1.0)
        found.append(StageCost("slab", slab, "after"))
        found += [StageCost(name, part * slab, "after") for name, part in SLAB_AGAIN.items()]
    found += _flown_again(scene, airflow, fractions)
    if airflow.wake is not None or airflow.span is not None:
        found.append(StageCost("residence", RESIDENCE, "after"))
    return (*found, StageCost("report", REPORT, "after"))


def _airflow_stages(scene: Scene, airflow: AirflowPlan) -> Iterator[StageCost]:
    """Meshes, solutions and fields, the answer's own and those of its other grids."""
    if airflow.stepping is None:
        return
    steady = airflow.stepping == "steady"
    for number, scale in enumerate(airflow.scales):
        grid = "" if number == 0 else f"grid x {scale:.2g} "
        own, before = ("answer", "first") if number == 0 else ("beside", "beside")
        cells = typical_cells(scene, airflow, number)
        yield StageCost(f"{grid}mesh", MESHED[0] + MESHED[1] * cells, before)
        start, rest = solver_seconds(scene, airflow, number)
        if not steady:
            yield StageCost(f"{grid}draft mesh", MESHED[0] + 0.5 * MESHED[1] * cells, before)
            yield StageCost(f"{grid}draft airflow", start, before)
            yield StageCost(f"{grid}draft field", READ["steady"], "beside")
        yield StageCost(f"{grid}airflow", rest + span_cost(scene, airflow).core_seconds * (number == 0), own)
        yield StageCost(f"{grid}field", READ[airflow.stepping], own)


def _loading_stages(scene: Scene, airflow: AirflowPlan, fractions: Mapping[str, FractionPlan]) -> Iterator[StageCost]:
    """The passes of the air that feels the granules, through the steady airflow."""
    steady = airflow.stepping == "steady"
    draft, when = "" if steady else "draft ", "after" if steady else "beside"
    gathered = _flown(airflow, fractions, GATHERED)
    yield StageCost(f"{draft}momentum", gathered, when, PASSES + 1)
    start, rest = solver_seconds(scene, airflow, 0)
    yield StageCost(f"{draft}loaded-airflow", AGAIN_UNDER_FORCE * (rest if steady else start), when, PASSES)


def _fed(scene: Scene) -> int:
    """Granules of a fraction, in all replicates."""
    return REPLICATES * replicate_size(scene.feed.count)


def _flown(airflow: AirflowPlan, fractions: Mapping[str, FractionPlan], count: int) -> float:
    """Seconds in which ``count`` granules of every fraction fly once."""
    effort = sum(forces[force].effort for fraction in fractions.values() for force in fraction.forces)
    one = SECONDS_A_GRANULE if airflow.stepping is not None or airflow.rung == "given" else IN_KNOWN_AIR
    return EACH_STAGE + (BY_CHAIN if airflow.rung == "none" else one) * count * (len(fractions) + effort)


def _flown_again(scene: Scene, airflow: AirflowPlan, fractions: Mapping[str, FractionPlan]) -> Iterator[StageCost]:
    """The stages in which a part of the granules flies again, for the budget."""
    compared = _flown(airflow, fractions, _fed(scene) * COMPARED // REPLICATES) - EACH_STAGE
    for stage, times in times_again(airflow).items():
        ahead = airflow.stepping is not None and stage.startswith(("draft ", "grid "))
        drawn = DRAWS * DRAWN * len(fractions) if stage == "draws" and airflow.rung != "none" else 0.0
        yield StageCost(stage, EACH_STAGE + drawn + compared * times, "beside" if ahead else "after")
