"""The kind of airflow that is resolved in three dimensions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import known
from ...core.lazy import cached_property
from ...core.store import content_key
from ...laws.span import CONVECTIVE_PERIOD
from ...planning.stage_cache import code_of, version_of
from .airflow_kinds import airflow_kinds
from .realisations import Realisations
from .solved_air import SolvedAir

if TYPE_CHECKING:
    from ..field import FlowField
    from ..foam import AirflowResult


@airflow_kinds.register("three-dimensional")
class SpanAir(SolvedAir):
    """A scale-resolving solution in three dimensions: its layers are realisations of a plane wake."""

    means = "the wake in three dimensions"
    code = "air.foam.spanwise.span_run"

    def start(self) -> Path:
        return self.steady().case

    @property
    def solve(self) -> Callable[..., AirflowResult]:
        from ..foam.spanwise.span_run import solve_span

        return partial(solve_span, force=self.force)

    @property
    def cells(self) -> int:
        return super().cells * known(self.flow_spec.span).layers

    @cached_property
    def layers(self) -> tuple[str, Path]:
        """Cache key and folder of the fields, a file a layer that is flown in."""
        from .case_field import save_layers

        key = content_key("layers", self.solution[0], code_of("air.kinds.case_field"), version_of("foamlib"))

        def work(part: Path) -> None:
            self.cache.tell("field", "reading the layers of the airflow")
            save_layers(self.case, part, self.flow_spec, known(self.measured.span).flown)

        return key, self.cache.make("field", key, work)

    def make_field(self) -> tuple[str, FlowField]:
        from .case_field import layer_file

        key, folder = self.layers
        return key, self._loaded(layer_file(folder, 0))

    @cached_property
    def realisations(self) -> Realisations:
        """The layers that are flown in, each read when it is."""
        from .case_field import layer_file

        folder, count = self.layers[1], len(known(self.measured.span).flown)
        first, *others = (partial(self._loaded, layer_file(folder, number)) for number in range(count))
        return Realisations(first(), tuple(others), self.cycles)

    @cached_property
    def cycles(self) -> int:
        """Parts of a layer's period that count as independent: as many, over all layers, as there were sheddings.

        Layers of one run shed together, so that they are no further samples of that.
        """
        found = self.measured
        number = 1.0 / CONVECTIVE_PERIOD if found.strouhal is None else found.strouhal.value
        sheddings = known(found.period) / self.flow_spec.convective_time * number
        return max(1, int(sheddings / len(known(found.span).flown)))

    @property
    def model_is_unknown(self) -> bool:
        return True
