"""The fields of a solved airflow that granules can fly in, files in the cache."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from ...core.record import load
from ...core.store import content_key
from ...laws.span import CONVECTIVE_PERIOD, Span
from ...planning.stage_cache import code_of, version_of
from ..foam.read import loop_of
from .airflow_kinds import CaseAir
from .airflow_table import SpanAirflow
from .case_field import case_field, layer_file, save_layers, state_fields


class StoredFields(NamedTuple):
    """The file of the field that is ``shown`` in pictures, those that are ``flown`` in, each as likely as the others,
    and the ``cycles`` of the shedding in their period, each a sample of the airflow; 1 where nothing changes.
    """

    shown: Path
    flown: Sequence[Path]
    cycles: int


def plane_fields(air: CaseAir) -> StoredFields:
    """Those of a plane airflow: field.npz, and state-N.npz for each late state of one that does not settle. Its cycles
    are whole shedding periods of the loop that the case keeps.
    """

    def write(part: Path) -> None:
        air.cache.tell("field", "reading the airflow")
        density = air.scene.airstream.density
        case_field(air.case, air.measured.field_time, density, half=air.half).save(part / "field.npz")
        for number, state in enumerate(state_fields(air.case, density, half=air.half)):
            state.save(part / f"state-{number}.npz")

    folder = _made("field", air, write)
    loop = loop_of(air.case) if air.measured.period is not None else None
    shown, cycles = folder / "field.npz", 1 if loop is None else max(1, int(loop["periods"]))
    return StoredFields(shown, sorted(folder.glob("state-*.npz")) or [shown], cycles)


def layer_fields(air: CaseAir, span: Span) -> StoredFields:
    """Those of an airflow in three dimensions: the layers that are flown in, each a plane wake.

    Its cycles are the parts of a layer's period that count as independent: as many, over all layers, as there were
    sheddings. Layers of one run shed together, so that they are no further samples of that.
    """
    spec, found = air.flow_spec, load(SpanAirflow, air.case / "airflow.json")
    flown = found.span.flown

    def write(part: Path) -> None:
        air.cache.tell("field", "reading the layers of the airflow")
        save_layers(air.case, part, spec, span.start_up * spec.convective_time, flown)

    folder = _made("layers", air, write)
    files = [layer_file(folder, number) for number in range(len(flown))]
    number = 1.0 / CONVECTIVE_PERIOD if found.strouhal is None else found.strouhal.value
    sheddings = found.period / spec.convective_time * number
    return StoredFields(files[0], files, max(1, int(sheddings / len(flown))))


def _made(what: str, air: CaseAir, write: Callable[[Path], None]) -> Path:
    """The folder of the fields, from the cache or written now."""
    key = content_key(what, air.solution[0], code_of("air.kinds.case_field"), version_of("foamlib"))
    return air.cache.make("field", key, write)
