"""A family of triangular prisms, apex up and down, from flat to steep, in upward air: one scene each.

.venv/bin/python cases/prisms.py [FOLDER] [--slopes 30,45,60]

Writes FOLDER/prism-APEX-SLOPE.toml (runs/prisms by default) from cases/prism.toml and prints what each would cost.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import wakeflow as wf

HERE = Path(__file__).parent


def prisms(slopes: Sequence[float]) -> Iterator[tuple[str, wf.Scene]]:
    """Name and scene of each slope (degrees from the horizontal) with the apex up, and with the base up."""
    shipped = wf.Scene.load(HERE / "prism.toml")
    for apex in ("up", "down"):
        for slope in slopes:
            body = {"body.prism.apex": apex, "body.prism.slope_angle": f"{slope:g} deg"}
            yield f"prism-{apex}-{slope:g}", shipped.replace(body)


def main(folder: Path, slopes: Sequence[float]) -> None:
    """Write the scenes and print the airflow that each needs, its time and its largest doubt."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, scene in prisms(slopes):
        scene.save(folder / f"{name}.toml")
        plan = wf.plan(scene)
        doubt = f"; {plan.warnings[0]}" if plan.warnings else ""
        print(f"{name}: rung {plan.rung}, about {plan.estimate['seconds'] / 60:.0f} min{doubt}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs", "prisms"))
    parser.add_argument("--slopes", default="30,45,60", help="degrees from the horizontal")
    asked = parser.parse_args()
    main(asked.folder, [float(x) for x in asked.slopes.split(",")])
