"""A family of rhombi: one scene for each slope and width, and what each would do without the air.

.venv/bin/python cases/rhombi.py [FOLDER] [--slopes 35,45,55] [--widths 40,60]

Writes FOLDER/rhombus-SLOPE-WIDTH.toml (runs/rhombi by default) from cases/rhombus.toml, with the bins moved along with
the body. Then all of them in one table: wakeflow sweep needs no script for keys of one scene, this is for what has to
change together.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import wakeflow as wf

HERE = Path(__file__).parent


def rhombi(slopes: Sequence[float], widths: Sequence[float]) -> Iterator[tuple[str, wf.Scene]]:
    """Name and scene of every slope (degrees) and width (mm); the bins' ends keep their distance in body widths."""
    shipped = wf.Scene.load(HERE / "rhombus.toml")
    for slope, width in product(slopes, widths):
        scale = 1e-3 * width / shipped.width
        ends = {
            f"bin.{name}.{end}": scale * getattr(place, attribute)
            for name, place in shipped.bin.items()
            for end, attribute in (("from", "start"), ("to", "to"))
        }
        channel = {"channel.width": scale * shipped.channel.width, "feed.width": scale * shipped.feed.width}
        body = {"body.rhombus.slope_angle": f"{slope:g} deg", "body.rhombus.width": f"{width:g} mm"}
        yield f"rhombus-{slope:g}-{width:g}", shipped.replace({**body, **channel, **ends})


def main(folder: Path, slopes: Sequence[float], widths: Sequence[float]) -> wf.Sweep:
    """Write the scenes, and look at all of them without the air, which takes seconds."""
    folder.mkdir(parents=True, exist_ok=True)
    scenes = dict(rhombi(slopes, widths))
    for name, scene in scenes.items():
        scene.save(folder / f"{name}.toml")
    found = wf.sweep(scenes, folder / "first-look", rung="none")
    for entry in found.table.entries:
        share = entry.by_name["recovery.wheat"]
        print(f"{entry.name}: {100 * share.value:.1f} % of the wheat in its bins, without the air")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs", "rhombi"))
    parser.add_argument("--slopes", default="35,45,55", help="degrees from the horizontal")
    parser.add_argument("--widths", default="40,60", help="mm across the air")
    asked = parser.parse_args()
    main(asked.folder, *([float(x) for x in text.split(",")] for text in (asked.slopes, asked.widths)))
