"""Run an airflow in three dimensions: in segments of flow time, resumable at any moment and over days.

A small disturbance dies in a wake that sheds strongly, and the flow stays plane: so it did behind a prism, at sixteen
times the price of a plane airflow (spanwise rms 3e-4 U after 0.37 s). Modes of finite strength, of many wave lengths
and behind the body where the wake amplifies them, broke every wake up that was tried.

A case has two parts. The folder itself is one layer of cells: the plane mesh, and the plane wake that all starts from.
The folder ``span`` below it is the same mesh extruded. When one of its segments has ended, the snapshots that it wrote
are packed into the first part (``span_record``) and their time folders removed. All times are fixed by the case, and
whatever is killed begins again with the segment it was in: any number of interruptions leaves the same files.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.errors import FoamError, MeshError
from ....core.files import atomic_write, write_json
from ....core.geometry import ForceDensity
from ....core.process import tail
from ....core.record import save
from ....core.tables import save_arrays
from ....laws.span import CADENCE, Span
from ..airflow_result import AirflowResult
from ..case import FlowSpec, SpanSpec, axis_points, write_case, write_parameters
from ..momentum_source import write_source
from ..programs import AirflowFailure, call, disk_trouble_named
from ..read import CaseFields, time_folders
from ..sanity import check_airflow
from ..solver import PHASE, drop_after, last_state, purge, run_segment, segment_ends
from ..start import first_step, prepare_case, start_in_time, write_internal
from ..time_resolved import watch_over
from ..watch import ProgressListener
from .span_measure import measure_span
from .span_record import LAYERS, PACKED, SpanRecord, pack

# -- What an airflow in three dimensions starts from -------------------------------------------------------------------
Array = NDArray[np.float64]
# Chosen: no result remembers them once the start-up is over.
MODES = 8  # waves along the span: of its whole length, half of it, ... an eighth
STRENGTH = 0.3  # of the inlet speed
PLACE, REACH = 1.2, (1.0, 1.5)  # widths behind the body, and across and along the air from there
WAVES = 4.2  # rms wave number in the plane times the width: phases that change over a body width
SEED = 7  # the same disturbance in every run of a case


def start_span(spec: SpanSpec, plane: Path, folder: Path) -> None:
    """Write the latest fields of the one-layer case ``plane``, with :func:`span_modes`, into 0/ of the case with a span
    in ``folder``.
    """
    fields = CaseFields(plane)
    latest = fields.folder("latest")
    with np.load(plane / LAYERS) as data:
        at, z = data["at"], data["z"]
    for name in ("U", "p", *(field.name for field in spec.model.fields)):
        values = fields.field(latest, name)[0][at]
        if name == "U":
            places = np.column_stack([fields.mesh.plane.centres[at], z])
            values = np.column_stack([values, np.zeros(len(at))]) + span_modes(spec, places)
        write_internal(folder / "0" / name, values)


def span_modes(spec: SpanSpec, places: Array) -> Array:
    """The disturbance (n, 3) m/s at ``places`` (n, 3) m: waves along the span with random phases in the plane."""
    middle, _, rear = axis_points(spec)
    size, random = spec.mesh.projected_width, np.random.default_rng(SEED)
    x, y = (places[:, 0] - middle) / size, (spec.along * places[:, 1] - rear) / size
    depth = spec.span.depth * size
    envelope = np.exp(-((x / REACH[0]) ** 2) - ((y - PLACE) / REACH[1]) ** 2)
    waves = np.zeros((len(places), 3))
    for component in range(3):
        for mode in range(1, MODES + 1):
            across, along = random.normal(0.0, WAVES, 2)
            phase = random.uniform(0.0, 2.0 * np.pi)
            waves[:, component] += np.cos(2.0 * np.pi * mode * places[:, 2] / depth + across * x + along * y + phase)
    rms = np.sqrt(0.5 * MODES)
    return np.asarray(STRENGTH * spec.speed / rms * envelope[:, None] * waves)


# -- From a one-layer case to one with a periodic span -----------------------------------------------------------------
BASE_POINTS = 8  # places along the span at which the base pressure is recorded
OFF = 1e-6  # body widths by which a cell may miss the plane cell it was extruded from: round-off


def extrude(spec: SpanSpec, plane: Path, folder: Path) -> None:
    """Write the case ``folder`` with the span of ``spec``: the mesh of the one-layer case ``plane``, extruded.

    ``layers.npz`` beside it (in ``plane``) holds the plane cell ``at`` (n,) and the height ``z`` (n,) m of each cell.
    Raises MeshError for a mesh that checkMesh refuses, FoamError where a program fails.
    """
    shutil.rmtree(folder, ignore_errors=True)
    write_case(spec, folder)
    shutil.copytree(plane / "constant" / "polyMesh", folder / "constant" / "polyMesh", dirs_exist_ok=True)
    write_parameters(folder, span_parameters(spec))
    call(folder, ["extrudeMesh"])
    make_periodic(folder / "constant" / "polyMesh" / "boundary", _depth(spec))
    call(folder, ["checkMesh"])
    log = folder / "log.checkMesh"
    if "Mesh OK" not in log.read_text():
        raise MeshError(f"OpenFOAM refuses the extruded mesh; log: {log}", command="checkMesh", log=log, tail=tail(log))
    call(folder, ["postProcess", "-func", "writeCellCentres", "-time", "0"])
    centres = np.column_stack([_scalar(folder / "0" / name) for name in ("Cx", "Cy", "Cz")])
    for name in ("C", "Cx", "Cy", "Cz"):
        (folder / "0" / name).unlink(missing_ok=True)
    at = layer_map(centres, CaseFields(plane).mesh.plane.centres, spec.mesh.projected_width)
    save_arrays(plane / LAYERS, {"at": at, "z": centres[:, 2]})


def _depth(spec: SpanSpec) -> float:
    """Depth of the span (m)."""
    return spec.span.depth * spec.mesh.projected_width


def span_parameters(spec: SpanSpec) -> dict[str, str | float | int]:
    """What system/parameters of a case with a span has otherwise than that of one layer.

    The span begins where the layer ended. Its coefficients are those of the whole depth; the base pressure is recorded
    at places along it.
    """
    depth, low = _depth(spec), spec.mesh.thickness
    middle, _, rear = axis_points(spec)
    heights = low + depth * (np.arange(BASE_POINTS) + 0.5) / BASE_POINTS
    return {
        "layer": "cyclic",
        "layers": spec.span.layers,
        "spanDepth": depth,
        "bodyArea": spec.mesh.projected_width * depth,
        "basePoint": " ".join(f"({middle:.9g} {spec.along * rear:.9g} {z:.9g})" for z in heights),
    }


def make_periodic(boundary: Path, depth: float) -> None:
    """Turn the patches front and back of constant/polyMesh/boundary into a pair, ``depth`` (m) apart along z.

    Raises FoamError where one of them is not there.
    """
    text = boundary.read_text()
    for name, other, shift in (("front", "back", -depth), ("back", "front", depth)):
        entries = (
            f"type            cyclic;\n        neighbourPatch  {other};\n        matchTolerance  1e-4;\n"
            f"        transform       translational;\n        separationVector (0 0 {shift:.12g});\n"
        )
        pattern = rf"(^\s*{name}\s*\{{\s*)type\s+\w+;\s*(?:inGroups[^;]*;\s*)?"
        text, count = re.subn(pattern, rf"\g<1>{entries}        ", text, count=1, flags=re.M)
        if count != 1:
            raise FoamError(f"{boundary} has no patch {name}: extrudeMesh did not make a span")
    with atomic_write(boundary) as stream:
        stream.write(text)


def layer_map(centres: Array, plane: Array, width: float) -> NDArray[np.intp]:
    """The plane cell (n,) that each cell is over, from the ``centres`` (n, 3) and those of the ``plane`` (m, 2).

    extrudeMesh does not keep the order of the cells. Raises FoamError for a cell over none.
    """
    from scipy.spatial import cKDTree

    distance, at = cKDTree(plane).query(centres[:, :2])
    worst = float(np.max(distance))
    if worst > OFF * width:
        raise FoamError(f"an extruded cell lies {worst:.3g} m beside the cell it was made from: remove the case")
    return np.asarray(at, dtype=np.intp)


def _scalar(path: Path) -> Array:
    from foamlib import FoamFieldFile

    return np.asarray(FoamFieldFile(path).internal_field, dtype=float)


# -- Run an airflow in three dimensions --------------------------------------------------------------------------------
SPAN = "span"  # the extruded case, below the one-layer one
# Convective times. Chosen:
PLANE = 15.0  # of the plane wake before it is extruded: the vortices have formed by then
SEGMENT = 2.0  # what an interruption may cost; starting the solver costs some per cent of it
COURANT = 2.0  # the largest Courant number; halved, down to
CAREFUL = 0.5  # this one, when a segment fails numerically
CADENCE_ROUNDING = 1e-6  # cadences


def _plane_wake(spec: FlowSpec, folder: Path, start: Path | None, listener: ProgressListener) -> None:
    """The plane wake that every layer starts from, time-resolved for PLANE convective times."""
    end = PLANE * spec.convective_time
    if last_state(folder) >= end * (1 - CADENCE_ROUNDING):
        return
    drop_after(folder, 0.0)
    start_in_time(spec, folder, start)
    watch = watch_over(spec, folder, "plane wake", listener, end)
    run_segment(folder, "pimpleFoam", end, {"deltaT": first_step(spec)}, watch)


def record_ends(span: Span, scale: float) -> list[float]:
    """The ends (s) of the run's segments, ``scale`` (s) being the convective time: whole snapshots, the last one's end
    not before that of the record.
    """
    beats, whole = round(SEGMENT / CADENCE), math.ceil(span.whole / CADENCE - CADENCE_ROUNDING)
    ends = [*range(beats, whole, beats), whole]
    return [beat * CADENCE * scale for beat in ends]


def _record(spec: SpanSpec, folder: Path, listener: ProgressListener) -> None:
    """Run segment after segment; where one fails numerically, the last two again with half the Courant number."""
    deep, scale = folder / SPAN, spec.convective_time
    ends = record_ends(spec.span, scale)
    watch = watch_over(spec, deep, "three dimensions", listener, ends[-1])
    while True:
        now, state = last_state(deep), json.loads((folder / PHASE).read_text())
        _pack_new(folder, now, spec.span.start_up * scale)
        following = [end for end in ends if end > now * (1 + CADENCE_ROUNDING)]
        if not following:
            return
        try:
            run_segment(deep, "pimpleFoam", following[0], {
                "deltaT": first_step(spec), "maxCo": state["courant"], "writeInterval": CADENCE * scale,
                "ranks": spec.ranks,
            }, watch)  # fmt: skip
        except AirflowFailure as failure:
            if not failure.cause.numerical or state["courant"] <= CAREFUL:
                raise
            write_json(folder / PHASE, {**state, "courant": 0.5 * state["courant"]})
            _go_back(folder)


def _pack_new(folder: Path, until: float, begin: float) -> None:
    """Pack the snapshots between ``begin`` and ``until`` (s), of segments that ended, and remove what is not needed."""
    deep = folder / SPAN
    for path in time_folders(deep):
        packed = folder / PACKED / f"{path.name}.npy"
        if begin * (1 - CADENCE_ROUNDING) <= float(path.name) <= until * (1 + CADENCE_ROUNDING) and not packed.exists():
            pack(path, folder)
    if until > 0:
        purge(deep)


def _go_back(folder: Path) -> None:
    """Forget the last segment that ended: it may hold the beginning of a failure."""
    deep, ends = folder / SPAN, segment_ends(folder / SPAN)
    drop_after(deep, ends[-2] if len(ends) > 1 else 0.0)
    now = last_state(deep)
    for path in (folder / PACKED).glob("*.npy"):
        if float(path.stem) > now * (1 + CADENCE_ROUNDING):
            path.unlink()


# -- One airflow in three dimensions from mesh to numbers --------------------------------------------------------------
def solve_span(
    spec: SpanSpec,
    msh: Path,
    folder: Path,
    *,
    start: Path | None = None,
    force: ForceDensity | None = None,
    listener: ProgressListener = lambda _: None,
) -> AirflowResult:
    """Solve the airflow of ``spec``, which has a span, in the case ``folder`` on the plane mesh ``msh``.

    ``airflow.json`` there holds the result, ``packed`` the snapshots. Arguments and failures as of
    :func:`wakeflow.air.foam.solve_airflow`; ``force`` is on the air of every layer. Goes on from what an interrupted
    call left. Raises AirflowFailure where no Courant number serves, too.
    """
    begun, deep, flat = time.monotonic(), folder / SPAN, spec.plane
    with disk_trouble_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        mesh = prepare_case(flat, msh, folder)
        if force is not None:
            write_source(folder, force, spec.density)
        _plane_wake(flat, folder, start, listener)
        if not (folder / PHASE).exists():
            extrude(spec, folder, deep)
            if force is not None:
                write_source(folder, force, spec.density, deep)
            start_span(spec, folder, deep)
            write_json(folder / PHASE, {"phase": "span", "courant": COURANT})
        _record(spec, folder, listener)
        record, begin = SpanRecord(folder, CaseFields(folder)), spec.span.start_up * spec.convective_time
        result = measure_span(spec, record, deep, begin, seconds=time.monotonic() - begun)
        checks = {check.name: check.used for check in check_airflow(spec, folder, result)}
        result = replace(result, mesh=mesh, checks=checks)
        save(folder / "airflow.json", result)
    return result
