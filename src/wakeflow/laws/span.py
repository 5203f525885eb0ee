"""The periodic span of an airflow that is resolved in three dimensions, and its times in convective ones."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.record import column

# Convective times (body width over inlet speed).
START_UP = 45.0  # in which the plane wake that a run starts from breaks up: after 15 to 20 behind a rhombus and a prism
# apex up, after 40 behind a prism apex down
CONVECTIVE_PERIOD = 6.0  # of a bluff body's shedding at its usual Strouhal number of 1/6
CADENCE = 0.25  # between snapshots: 24 a shedding


@dataclass(frozen=True)
class Span:
    """The third dimension of an airflow, where it is resolved: its periodic span."""

    depth: float = column("body widths", "length of the periodic span")
    layers: int = column("1", "layers of cells over it")
    sheddings: float = column("1", "usual shedding cycles recorded after the start-up")

    def __bool__(self) -> bool:
        """Whether there is a third dimension, :data:`IN_PLANE` having none."""
        return self.layers > 0

    @property
    def start_up(self) -> float:
        """Convective times that pass before the record begins."""
        return START_UP

    @property
    def recorded(self) -> float:
        """Length of the record in convective times."""
        return CONVECTIVE_PERIOD * self.sheddings

    @property
    def whole(self) -> float:
        """Length of the run in convective times, its start-up included."""
        return self.start_up + self.recorded


IN_PLANE = Span(0.0, 0, 0.0)
