"""What an airflow in three dimensions starts from: the plane wake in every layer, and modes along the span.

A small disturbance dies in a wake that sheds strongly, and the flow stays plane: so it did behind a prism, at sixteen
times the price of a plane airflow (spanwise rms 3e-4 U after 0.37 s). Modes of finite strength, of many wave lengths
and behind the body where the wake amplifies them, broke every wake up that was tried.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..core.files import atomic_write
from .case import FlowSpec, axis_points
from .case_fields import CaseFields
from .span_record import LAYERS

__all__ = ["span_modes", "start_span"]

Array = NDArray[np.float64]
# Chosen: no result remembers them once the start-up is over.
MODES = 8  # waves along the span: of its whole length, half of it, ... an eighth
STRENGTH = 0.3  # of the inlet speed
PLACE, REACH = 1.2, (1.0, 1.5)  # widths behind the body, and across and along the air from there
WAVES = 4.2  # rms wave number in the plane times the width: phases that change over a body width
SEED = 7  # the same disturbance in every run of a case


def start_span(spec: FlowSpec, plane: Path, folder: Path) -> None:
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
        _write_internal(folder / "0" / name, values)


def span_modes(spec: FlowSpec, places: Array) -> Array:
    """The disturbance (n, 3) m/s at ``places`` (n, 3) m: waves along the span with random phases in the plane."""
    middle, _, rear = axis_points(spec)
    size, random = spec.mesh.projected_width, np.random.default_rng(SEED)
    x, y = (places[:, 0] - middle) / size, (spec.along * places[:, 1] - rear) / size
    depth = known(spec.span).depth * size
    envelope = np.exp(-((x / REACH[0]) ** 2) - ((y - PLACE) / REACH[1]) ** 2)
    waves = np.zeros((len(places), 3))
    for component in range(3):
        for mode in range(1, MODES + 1):
            across, along = random.normal(0.0, WAVES, 2)
            phase = random.uniform(0.0, 2.0 * np.pi)
            waves[:, component] += np.cos(2.0 * np.pi * mode * places[:, 2] / depth + across * x + along * y + phase)
    rms = np.sqrt(0.5 * MODES)
    return np.asarray(STRENGTH * spec.speed / rms * envelope[:, None] * waves)


def _write_internal(path: Path, values: Array) -> None:
    """Replace a field's internalField by one value (n,) or vector (n, 3) a cell."""
    if values.ndim == 2:
        kind, rows = "vector", "\n".join(f"({x:.10g} {y:.10g} {z:.10g})" for x, y, z in values)
    else:
        kind, rows = "scalar", "\n".join(f"{value:.10g}" for value in values)
    entry = f"internalField   nonuniform List<{kind}>\n{len(values)}\n(\n{rows}\n);"
    text = re.sub(r"internalField\s+uniform[^;]*;", lambda _: entry, path.read_text(), count=1)
    with atomic_write(path) as stream:
        stream.write(text)
