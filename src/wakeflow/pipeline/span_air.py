"""The kind of airflow that is resolved in three dimensions."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import write_json
from ..core.resources import case_template
from ..core.store import content_key, digest_files
from ..planning.airflow import ranks_for
from ..planning.span import CONVECTIVE_PERIOD
from .airflow_kinds import SolvedAir, airflow_kinds
from .cache import code_of, version_of
from .realisations import Realisations

if TYPE_CHECKING:
    from ..field import FlowField

__all__ = ["SpanAir"]


@airflow_kinds.register("three-dimensional")
class SpanAir(SolvedAir):
    """A scale-resolving solution in three dimensions: its layers are realisations of a plane wake."""

    def start(self) -> Path:
        return self.steady().case

    def make_solution(self) -> tuple[str, Path]:
        from ..foam.span_airflow import solve_span
        from ..foam.version import openfoam_version

        (mesh_key, mesh_folder), spec = self.mesh, self.flow_spec
        assert spec.span is not None
        code = content_key(code_of("span"), digest_files([case_template()]), openfoam_version())
        if not spec.ranks:  # by the mesh alone, as those of every airflow
            spec = replace(spec, ranks=ranks_for(self.mesh_quality["cells"] * spec.span.layers)[0])
        asked = {name: value for name, value in asdict(spec).items() if name != "mesh"}
        key = content_key("span", mesh_key, asked, code)

        def work(part: Path) -> None:
            solve_span(
                spec,
                mesh_folder / "mesh.msh",
                part / "case",
                start=self.start(),
                listener=lambda now: self.cache.tell("airflow", str(now)),
            )

        return key, self.cache.make("airflow", key, work)

    @cached_property
    def layers(self) -> tuple[str, Path]:
        """Cache key and folder of the fields, a file a layer that is flown in."""
        from .span_field import save_layers

        key = content_key("layers", self.solution[0], code_of("layers"), version_of("foamlib"))

        def work(part: Path) -> None:
            self.cache.tell("field", "reading the layers of the airflow")
            save_layers(self.case, part, self.flow_spec, self.make_table())

        return key, self.cache.make("field", key, work)

    def make_field(self) -> tuple[str, FlowField]:
        from .span_field import layer_field

        key, folder = self.layers
        return key, layer_field(folder, 0)

    @cached_property
    def realisations(self) -> Realisations:
        """The layers that are flown in, each read when it is."""
        from .span_field import layer_field

        folder, count = self.layers[1], len(self.make_table()["span"]["flown"])
        others = tuple(partial(layer_field, folder, number) for number in range(1, count))
        return Realisations(layer_field(folder, 0), others, self.cycles)

    @cached_property
    def cycles(self) -> int:
        """Parts of a layer's period that count as independent: as many, over all layers, as there were sheddings.

        Layers of one run shed together, so that they are no further samples of that.
        """
        table = self.make_table()
        number = 1.0 / CONVECTIVE_PERIOD if table["strouhal"] is None else table["strouhal"]["value"]
        sheddings = table["period"] / self.flow_spec.convective_time * number
        return max(1, int(sheddings / len(table["span"]["flown"])))

    @cached_property
    def residence(self) -> dict[str, Any]:
        from .blended_air import residence_row

        body, air, airs = next(iter(self.scene.body.values())), self.scene.air, self.realisations
        assert air is not None
        asked = body.outline().tolist(), air.direction, air.speed, self.cycles
        key = content_key("residence", self.layers[0], asked, code_of("residence"))

        def work(part: Path) -> None:
            self.cache.tell("residence", "fine dust in the near wake")
            fields = [field for i in range(len(airs)) if (field := airs.make(i)) is not None]
            write_json(part / "residence.json", {"answer": residence_row(fields, *asked)})

        table: dict[str, Any] = json.loads((self.cache.make("residence", key, work) / "residence.json").read_text())
        return table

    @property
    def model_is_unknown(self) -> bool:
        return True
