"""Write one scene a slope angle, to run one by one or in a batch:

.venv/bin/python cases/studies/slope_angles.py runs/angles
for scene in runs/angles/*.toml; do .venv/bin/wakeflow run "$scene"; done
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import wakeflow as wf

ANGLES = (30, 40, 45, 50, 60)  # degrees from the horizontal


def main(folder: Path) -> None:
    """Write the scenes into ``folder`` and print where."""
    base = wf.Scene.load(Path(__file__).parents[1] / "rhombus.toml")
    folder.mkdir(parents=True, exist_ok=True)
    for angle in ANGLES:
        path = folder / f"slope-{angle}.toml"
        base.replace({"body.rhombus.slope_angle": math.radians(angle)}).save(path)
        print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/angles"))
