"""What a plan will cost: the seconds of each stage, memory and disk, before anything is started.

The program's own stages are registered here, each with what it costs. All numbers are measured: runs of the shipped
scenes on two cores of 2020s hardware. What this machine makes of the seconds is in
:mod:`..flight.stages.machine_rates`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..laws.forces import forces
from ..scene import Scene
from .airflow_choice import AirflowPlan
from .collisions import CLOCK, CollisionPlan
from .feed_funnel import ENGINE, bead_engines
from .plan import (
    AT_ONCE,
    COMPARED,
    GATHERED,
    KEPT,
    PASSING,
    REPLICATES,
    CostEstimate,
    FractionPlan,
    gathered,
    replicate_size,
)  # fmt: skip
from .stages import FLIGHTS, OWN, AirLabel, FliesAgain, Scaling, Stage, StageCost, StageKey, Workload, stages
from .wake import MEMORY, SpanCost, cost_of

# -- What an airflow will cost, before its mesh is made ----------------------------------------------------------------
SECONDS = {"steady": 11.5, "time-resolved": 28.0}  # of solving on 2020s hardware at the usual mesh, a body, one core
AT_LEAST = {"steady": 1.0, "time-resolved": 9.0}  # s that come on top, of programs that start and of files
DEVELOPED = 0.68  # times as long: a time-resolved solution that starts from a coarser grid's wake, not the steady one
UNMIRRORED = 3.4  # times as long: a steady solution of the whole channel, which has more cells and settles late
WORTH_IT = 60_000  # cells from which a second MPI rank pays
RANKS = 2  # from there on, on every machine: the number of ranks is part of what is computed, by rounding
CELLS = {"steady": 5000.0, "time-resolved": 8000.0}  # typical, a body


def ranks_for(cells: int) -> tuple[int, str]:
    """MPI ranks for a case of so many cells, whatever machine it runs on, and the reason."""
    if cells < WORTH_IT:
        return 1, f"one process: {cells} cells are too few to share (two MPI ranks from {WORTH_IT} cells)"
    return RANKS, f"{RANKS} MPI ranks of about {cells // RANKS} cells"


def typical_cells(scene: Scene, airflow: AirflowPlan, grid: int = 0) -> float:
    """Cells to expect on a grid of the plan, 0 the answer's, before it is meshed; good to a factor of two."""
    layers = 1 if not airflow.span else airflow.span.layers
    if not airflow.stepping:
        return 0.0
    return layers * CELLS[airflow.stepping] * len(scene.body) / _edges(scene, airflow, grid) ** 2


def span_cost(scene: Scene, airflow: AirflowPlan) -> SpanCost:
    """What the third dimension costs, before the mesh is made; nothing where it is not resolved."""
    if not airflow.span:
        return SpanCost(0.0, 0.0, 0.0, 0.0, 0.0)
    scale = airflow.scales[0] * scene.numerics.mesh_scale
    return cost_of(airflow.span, CELLS["time-resolved"] * len(scene.body) / scale**2, scale)


def solver_seconds(scene: Scene, airflow: AirflowPlan, grid: int = 0) -> tuple[float, float]:
    """Seconds of OpenFOAM to expect on one core, on a grid of the plan: of the steady solution beside a time-resolved
    one, 0 where it is steady itself, and of the airflow; good to a factor of two.

    The time step goes with the cells' edges, and so do the iterations of a steady solution that settles; one of the
    whole channel often does not, and then ends after about as many on all meshes.
    """
    if not airflow.stepping:
        return 0.0, 0.0
    edges = _edges(scene, airflow, grid)
    size = len(scene.body) / edges**3
    steady = airflow.stepping == "steady"
    half = airflow.half if steady else airflow.symmetric
    start = AT_LEAST["steady"] + SECONDS["steady"] * size * (1.0 if half else UNMIRRORED * edges)
    if airflow.span:
        return start, 0.0
    developed = airflow.scales[1:] if airflow.loaded else airflow.scales[grid + 1 :]
    in_time = AT_LEAST["time-resolved"] + (DEVELOPED if developed else 1.0) * SECONDS["time-resolved"] * size
    return (0.0, start) if steady else (start, in_time)


def _edges(scene: Scene, airflow: AirflowPlan, grid: int) -> float:
    """Cell edges on a grid, over the usual ones."""
    return airflow.scales[grid] * scene.numerics.mesh_scale


# -- What a plan will cost ---------------------------------------------------------------------------------------------
STARTED = 2.0  # s: importing and planning
REPORT = 6.0  # s: the errors put together, figures, tables and the field's files
SECONDS_A_GRANULE = 120e-6  # s of both cores past a body: one flight with drag and weight; dispersion doubles it
IN_KNOWN_AIR = 120e-6  # s of both cores: the same in air that is known without triangles
WITHOUT_AIR = 30e-6  # s of both cores: of a flight from impact to impact
EACH_STAGE = 0.2  # s of a stage in which granules fly, however few they are
MESHED = 0.5, 3.0e-4  # s of a mesh, and of each cell
READ = {"steady": 0.4, "time-resolved": 1.6}  # s: the field of a solved airflow
AGAIN_UNDER_FORCE = 0.6  # a solution under force over a first one
LEADING_ON = 0.25  # the same where it leads only to the next pass
PROGRAM = 4e8  # bytes: the interpreter with its libraries
IN_AIR = 1.8e8  # bytes: the kernels of a solved airflow and its field
BYTES_IN_TIME = 200.0  # bytes of memory a cell and snapshot: a time-resolved field
MESHER, SOLVER = 1.5e8, 1e8  # bytes: the process of Gmsh or LIGGGHTS; of OpenFOAM without its cells
BYTES_IN_FLIGHT = 1000.0  # bytes of memory a granule that is fed and flown at the time
BYTES_LANDED = 60.0  # bytes of memory a granule and fraction: its row of landings
BYTES_ANSWERED, FEW = 8e5, 16  # bytes of memory a fraction beyond so many: what inputs do to it, its rows of the page
FILES = 1e6  # bytes: tables and report
BYTES_A_CELL = 1500.0  # bytes of disk a cell: the mesh in text
BYTES_A_SNAPSHOT = 80.0  # bytes of disk a cell and snapshot: its fields
SNAPSHOTS = {"time-resolved": 150.0, "steady": 2.0}  # number kept of an airflow
# Granules whose steps take as long as bringing the changing air to a step of the slab's clock: between what two runs of
# the shipped rhombus say, with 2400 and 500 granules in flight
AIR_IN_TIME = 250.0
SLAB_IN_KNOWN_AIR = 0.25  # of its time in air on triangles
BYTES_STORED = 80.0  # bytes of disk a granule and fraction: its row of landings, compressed


class AirflowCost(NamedTuple):
    """What an airflow alone costs: ``seconds``, and bytes of ``disk``."""

    seconds: float
    disk: float


def airflow_cost(scene: Scene, airflow: AirflowPlan) -> AirflowCost:
    """What is shared by all scenes that fly in one airflow."""
    cells, deep = typical_cells(scene, airflow), span_cost(scene, airflow)
    kept = 0.0 if airflow.span else BYTES_A_SNAPSHOT * SNAPSHOTS[airflow.stepping or "steady"]
    work = Workload(scene, airflow, None, 0, 0.0)
    seconds = sum(cost.whole for stage in SHARED for cost in stage.cost(work))
    return AirflowCost(seconds, cells * (BYTES_A_CELL + kept) + deep.disk)


def estimate_cost(
    scene: Scene, airflow: AirflowPlan, fractions: Mapping[str, FractionPlan], expected: Sequence[StageCost]
) -> CostEstimate:
    """What a run of these ``expected`` stages costs."""
    beside = MESHER if any(stage.when in ("meanwhile", "beside") for stage in expected) else 0.0
    air, kept = airflow_cost(scene, airflow), BYTES_STORED * min(_fed(scene), KEPT) * len(fractions)
    return CostEstimate(
        seconds=wall_seconds(expected),
        memory=max(stage.memory for stage in expected) + beside,
        disk=FILES + air.disk + kept,
    )


def memory_of(work: Workload, key: StageKey) -> float:
    """Bytes that a run holds at most in a stage, with the program that the stage starts; good to a factor of 1.5."""
    cells, count = typical_cells(work.scene, work.airflow), _fed(work.scene)
    held = PROGRAM + (IN_AIR if work.airflow.stepping else 0.0)
    held += BYTES_ANSWERED * max(0, work.fractions - FEW)
    if work.airflow.stepping == "time-resolved" and not work.airflow.span:
        held += BYTES_IN_TIME * SNAPSHOTS["time-resolved"] * cells
    more = {
        "funnel": MESHER,
        "mesh": MESHER,
        "airflow": SOLVER + MEMORY * cells,
        FLIGHTS: BYTES_IN_FLIGHT * min(count, AT_ONCE) + BYTES_LANDED * min(count, KEPT) * work.fractions,
        "slab": 0.0 if work.collisions is None else work.collisions.memory,
    }
    return held + more.get(key.stage.work, 0.0)


def begins(expected: Sequence[StageCost], cores: int = 2, started: float = STARTED) -> Iterator[float]:
    """When each of the ``expected`` stages begins (s after the start of a run, the first at ``started``). What does not
    need the answer's own airflow is made beside it, on another core where there is one.
    """
    free = dict.fromkeys(StageCost.ORDER, started)
    for stage in expected:
        yield free[stage.when]
        end = free[stage.when] + stage.whole
        for when in StageCost.ORDER[StageCost.ORDER.index(stage.when) :]:
            if cores == 1 or (stage.when, when) not in (("meanwhile", "first"), ("answer", "beside")):
                free[when] = max(free[when], end)


def wall_seconds(expected: Sequence[StageCost], cores: int = 2, started: float = STARTED) -> float:
    """Seconds until the last of the ``expected`` stages is done, see ``begins``."""
    ends = [begun + stage.whole for begun, stage in zip(begins(expected, cores, started), expected, strict=True)]
    return max(ends, default=started)


def expected_stages(
    scene: Scene,
    airflow: AirflowPlan,
    fractions: Mapping[str, FractionPlan],
    collisions: CollisionPlan | None,
    sources: Iterable[FliesAgain] = (),
) -> tuple[StageCost, ...]:
    """The stages of a run, and those in which the ``sources`` of its budget fly granules again, in the order in which
    they are usually done.
    """
    effort = sum(forces[force].effort for fraction in fractions.values() for force in fraction.forces)
    work = Workload(scene, airflow, collisions, len(fractions), len(fractions) + effort)
    again = [cost for source in sources for cost in source.costs(work)]
    costs = [*(cost for name in stages for cost in stages[name].cost(work)), *again]
    costs.sort(key=lambda cost: StageCost.ORDER.index(cost.when))
    costs.append(StageCost(StageKey(OWN, "report"), REPORT, "after"))
    return tuple(replace(cost, memory=memory_of(work, cost.key)) for cost in costs)


def flown_again(
    work: Workload, name: str, times: float, label: AirLabel = OWN, *, more: float = 0.0
) -> Iterator[StageCost]:
    """The cost of a stage in which the granules of a comparison fly ``times`` again, or of one that takes so many times
    as long as the slab, where there is one; in the answer's own airflow or that with the ``label``; ``more``: seconds
    of anything else.
    """
    key = StageKey(label, name)
    if key.stage.work != "slab":
        ahead = label != OWN and work.airflow.stepping
        compared = _flown(work, _fed(work.scene) * COMPARED // REPLICATES) - EACH_STAGE
        yield StageCost(key, EACH_STAGE + more + compared * times, "beside" if ahead else "after")
    elif work.collisions is not None:
        yield StageCost(key, times * _slab_seconds(work, work.collisions), "after")


def _pouring(work: Workload) -> Iterator[StageCost]:
    if work.scene.funnel is not None and work.scene.funnel.computed:
        yield StageCost(StageKey(OWN, "funnel"), bead_engines[ENGINE].seconds(work.scene.funnel), "first")


def _airs(work: Workload) -> Iterator[tuple[int, AirLabel, str, str]]:
    """Number and label of every solved airflow of a run, and when its mesh is made and when it is solved: the answer's
    own, those on coarser grids, from which it starts in time, and the steady ones beside them: from which the coarsest
    starts, in which the granules' force is gathered, and all where they are ends of a bracket.
    """
    airflow, in_time = work.airflow, work.airflow.stepping == "time-resolved"
    for number, scale in reversed([*enumerate(airflow.scales if airflow.stepping else ())]):
        label = OWN if number == 0 else AirLabel(grid=scale)
        solved = "answer" if number == 0 or (in_time and not airflow.loaded) else "beside"
        meshed = "first" if number == 0 else "meanwhile" if airflow.loaded else solved
        if in_time and (airflow.brackets or not airflow.scales[number + 1 :] or (airflow.loaded and number == 0)):
            when = "beside" if number == 0 and airflow.scales[1:] and not airflow.loaded else meshed
            yield number, label._replace(draft=True), when, when
        yield number, label, meshed, solved


def _meshing(work: Workload) -> Iterator[StageCost]:
    for number, label, meshed, _ in _airs(work):
        cells = typical_cells(work.scene, work.airflow, number)
        half = 0.5 if label.draft else 1.0
        yield StageCost(StageKey(label, "mesh"), MESHED[0] + half * MESHED[1] * cells, meshed)


def _developing(work: Workload) -> Iterator[StageCost]:
    """The wake in time on the coarsest grid under the force as it is known first: all others start from it."""
    if work.airflow.loaded and work.airflow.stepping == "time-resolved" and (coarser := work.airflow.scales[1:]):
        seconds = solver_seconds(work.scene, work.airflow, len(coarser))[1]
        yield StageCost(StageKey(AirLabel(grid=coarser[-1]), "early-airflow"), seconds, "meanwhile")


def _solving(work: Workload) -> Iterator[StageCost]:
    for number, label, _, solved in _airs(work):
        start, rest = solver_seconds(work.scene, work.airflow, number)
        deep = span_cost(work.scene, work.airflow).core_seconds * (number == 0)
        yield StageCost(StageKey(label, "airflow"), start if label.draft else rest + deep, solved)


def _reading(work: Workload) -> Iterator[StageCost]:
    for _, label, _, solved in _airs(work):
        seconds = READ["steady" if label.draft else work.airflow.stepping or "steady"]
        yield StageCost(StageKey(label, "field"), seconds, solved if label == OWN else "beside")


def _gathering(work: Workload) -> Iterator[StageCost]:
    """The passes of the air that feels the granules, through the steady airflow; the answer's own waits for them."""
    if work.airflow.loaded:
        of_answer = work.airflow.stepping != "time-resolved"
        key = StageKey(AirLabel(draft=not of_answer), "momentum")
        count, meet = work.scene.feed.count, _passes(work) > work.scene.numerics.loading_passes
        each, last = (_flown(work, gathered(count, most)) for most in (PASSING if meet else GATHERED, GATHERED))
        seconds = each + meet * last / (_passes(work) + 1)
        yield StageCost(key, seconds, "answer" if of_answer else "first", _passes(work) + 1)


def _gathering_in_slab(work: Workload) -> Iterator[StageCost]:
    """COMPARED replicates of the slab, each three times as long as it takes to start up."""
    collisions = work.collisions
    if work.airflow.loaded and collisions is not None and _passes(work) > 1:
        of_answer = work.airflow.stepping != "time-resolved"
        part = (
            COMPARED
            * 3.0
            * collisions.start_up
            / (collisions.replicates * (collisions.operation + 2.0 * collisions.start_up))
        )
        key = StageKey(AirLabel(draft=not of_answer), "slab-momentum")
        yield StageCost(key, part * collisions.seconds, "answer" if of_answer else "first")


def _passes(work: Workload) -> int:
    """Passes under the force of granules alone, and, if they are several, one under that of granules that meet."""
    most = work.scene.numerics.loading_passes
    return most + (most > 1 and work.collisions is not None)


def _loading(work: Workload) -> Iterator[StageCost]:
    """The steady airflow under the force: in every pass, and once on each other grid."""
    for number, label, _, solved in _airs(work) if work.airflow.loaded else ():
        if label.draft or work.airflow.stepping == "steady":
            first = solver_seconds(work.scene, work.airflow, number)[not label.draft]
            times = _passes(work) if number == 0 else 1
            mean = (AGAIN_UNDER_FORCE + LEADING_ON * (times - 1)) / times
            when = solved if number == 0 else "beside"
            yield StageCost(StageKey(label, "loaded-airflow"), mean * first, when, times)


def _flying(work: Workload) -> Iterator[StageCost]:
    yield StageCost(StageKey(OWN, "tracks"), _flown(work, _fed(work.scene)), "after")


def _in_slab(work: Workload) -> Iterator[StageCost]:
    """Cost of the slab: as many replicates as lie in the middle between the fewest and all."""
    if work.collisions is not None:
        flown = 0.5 * (work.collisions.fewest / work.collisions.replicates + 1.0)
        yield StageCost(StageKey(OWN, "slab"), flown * _slab_seconds(work, work.collisions), "after")


def _slab_seconds(work: Workload, collisions: CollisionPlan) -> float:
    """Seconds of all replicates of the slab."""
    slower = SLAB_IN_KNOWN_AIR if work.airflow.kind == "analytic" else 1.0
    if work.airflow.stepping == "time-resolved":
        slower *= 1.0 + AIR_IN_TIME / (sum(collisions.in_flight.values()) + CLOCK)
    return collisions.seconds * slower


def _fed(scene: Scene) -> int:
    """Granules of a fraction, in all replicates."""
    return REPLICATES * replicate_size(scene.feed.count)


def _flown(work: Workload, count: int) -> float:
    """Seconds in which ``count`` granules of every fraction fly once."""
    in_air = SECONDS_A_GRANULE if work.airflow.stepping or work.airflow.rung == "given" else IN_KNOWN_AIR
    return EACH_STAGE + (WITHOUT_AIR if work.airflow.rung == "none" else in_air) * count * work.effort


MESH = Stage("mesh", "mesh", Scaling.CELLS, "airflow", _meshing)
AIRFLOW = Stage("airflow", "airflow", Scaling.AIR, "airflow", _solving)
FIELD = Stage("field", "field", Scaling.CELLS, "airflow", _reading)
MOMENTUM = Stage("momentum", FLIGHTS, Scaling.AIR, "air loading", _gathering)
SLAB_MOMENTUM = Stage("slab-momentum", "slab", Scaling.AIR, "air loading", _gathering_in_slab)
DEVELOPING = Stage("early-airflow", "airflow", Scaling.AIR, "airflow", _developing)
LOADED = Stage("loaded-airflow", "airflow", Scaling.AIR, "air loading", _loading)
SHARED = MESH, AIRFLOW, DEVELOPING, FIELD, MOMENTUM, LOADED  # by all scenes that fly in one airflow
COMPILE = Stage("compile", work="compile", scaling=Scaling.ONCE, heading="compilation")
# In the order in which they are usually done. Those without a cost are part of another, or of few runs.
for _one in (
    Stage("funnel", "funnel", Scaling.ONCE, "funnel", _pouring),
    COMPILE,
    MESH,
    AIRFLOW,
    DEVELOPING,
    Stage("span", scaling=Scaling.AIR),
    Stage("given", scaling=Scaling.ONCE),
    Stage("duct", scaling=Scaling.ONCE),
    FIELD,
    Stage("layers", scaling=Scaling.CELLS),
    Stage("blend", scaling=Scaling.CELLS),
    MOMENTUM,
    SLAB_MOMENTUM,
    LOADED,
    Stage("tracks", heading="tracks", cost=_flying),
    Stage("slab", "slab", Scaling.SLAB, "slab", _in_slab),
    Stage("draws", heading="draws"),
    Stage("film"),
    Stage("vtk", scaling=Scaling.ONCE, heading="report"),
    Stage("drawings", scaling=Scaling.ONCE, heading="report"),
    Stage("report", heading="report"),
):
    stages.add(_one.name, _one)
