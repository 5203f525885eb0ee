"""The machine for ParaView: bodies, bins, walls and secondary inlets as named blocks."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ...core.files import atomic_write
from .files import lifted, lines_of, save_piece

if TYPE_CHECKING:
    from ...scene import Scene

HEAD = '<?xml version="1.0"?>\n<VTKFile type="vtkMultiBlockDataSet" version="1.0" byte_order="LittleEndian">\n'
FOOT = "  </vtkMultiBlockDataSet>\n</VTKFile>\n"


def write_machine(folder: Path | str, scene: Scene) -> Path:
    """Write machine.vtm: the groups bodies, bins, walls and inlets, each of blocks with the scene's own names.

    Bodies are polygons at the middle of their motion, the others lines. A body that vibrates has in its field data the
    ``vibration (m)``, its amplitude (x, y), and the ``frequency (Hz)``.
    """
    folder, place = Path(folder), Path(folder) / "machine"
    shutil.rmtree(place, ignore_errors=True)
    lines = ["  <vtkMultiBlockDataSet>\n"]
    for number, (group, blocks) in enumerate(_groups(scene).items()):
        lines.append(f'    <Block index="{number}" name={quoteattr(group)}>\n')
        for index, (name, block) in enumerate(blocks.items()):
            file = save_piece(block, place / f"{group}_{index:02d}.vtp")
            path = quoteattr(f"machine/{file.name}")
            lines.append(f'      <DataSet index="{index}" name={quoteattr(name)} file={path}/>\n')
        lines.append("    </Block>\n")
    with atomic_write(folder / "machine.vtm") as stream:
        stream.write("".join([HEAD, *lines, FOOT]))
    return folder / "machine.vtm"


def _groups(scene: Scene) -> dict[str, dict[str, Any]]:
    channel, half = scene.channel, scene.channel.width / 2
    walls = {side: [(x, channel.bottom), (x, channel.top)] for side, x in (("left", -half), ("right", half))}
    inlets = {
        name: [(-half if inlet.side == "left" else half, y) for y in inlet.span]
        for name, inlet in channel.inlet.items()
    }
    groups = {
        "bodies": {name: _body(scene, body.outline()) for name, body in scene.body.items()},
        "bins": {name: lines_of([bin_.line(channel)]) for name, bin_ in scene.bin.items()},
        "walls": {name: lines_of([ends]) for name, ends in walls.items()},
        "inlets": {name: lines_of([ends]) for name, ends in inlets.items()},
    }
    return {name: blocks for name, blocks in groups.items() if blocks}


def _body(scene: Scene, outline: Any) -> Any:
    import pyvista

    polygon = pyvista.PolyData(lifted(outline), faces=[len(outline), *range(len(outline))])
    if scene.vibration is not None:
        polygon.field_data["vibration (m)"] = np.abs(scene.motion[0])
        polygon.field_data["frequency (Hz)"] = np.array([1.0 / scene.vibration.period])
    return polygon
