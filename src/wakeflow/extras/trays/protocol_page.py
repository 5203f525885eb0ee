"""protocol.html: what to count of a machine, one page to print with its drawing and a form to write on."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...core.files import atomic_write
from ...scene import RESERVED_BIN, Scene
from ...show.canvas import bins_across
from ...show.html.template import page_template
from ...show.sketch import draw_sketch


def write_protocol(path: Path, scene: Scene, found: Any, fractions: Sequence[str]) -> None:
    """Write the page of a protocol (:class:`wakeflow.extras.trays.protocol.Protocol`) of ``scene``, with a form for
    each of the ``fractions`` that are counted.
    """
    picture = io.BytesIO()
    draw_sketch(scene).figure.savefig(picture, format="png")
    repetitions = {name: max(one.repetitions for one in found.steps if one.fraction == name)
                   for name in dict.fromkeys(step.fraction for step in found.steps)}  # fmt: skip
    text = page_template("protocol.html.j2", Path(__file__).parent).render(
        found=found,
        repetitions=repetitions or dict.fromkeys(fractions, 1),
        bins=[*bins_across(scene), RESERVED_BIN],
        sketch=base64.b64encode(picture.getvalue()).decode("ascii"),
    )
    with atomic_write(path) as stream:
        stream.write(text)
