"""Print where each fraction lands in the plain scene of Fig. 7, with an additional air stream, and with a barrier:

.venv/bin/python cases/paper/compare.py [options of wakeflow run, such as --set numerics.mesh_scale=2]

Runs what has not been run yet; results in runs/fig7, runs/air-stream and runs/barrier.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from wakeflow.cli import main as wakeflow

SCENES = ("fig7", "air-stream", "barrier")


def main(options: list[str]) -> int:
    tables = {}
    for name in SCENES:
        code = wakeflow(["run", str(Path(__file__).with_name(f"{name}.toml")), "--quiet", *options])
        if code:
            return code
        tables[name] = json.loads(Path("runs", name, "result.json").read_text())["separation"]
    bins = tables[SCENES[0]]["bins"]
    print(f"| fraction | scene | {' | '.join(bins)} | recovery |")
    print(f"| --- | --- |{' ---: |' * (len(bins) + 1)}")
    for fraction in tables[SCENES[0]]["fractions"]:
        for name in SCENES:
            row, whole = tables[name]["fractions"][fraction], tables[name]["recovery"][fraction]
            cells = [f"{100 * row[place]['share']:.1f}" for place in bins]
            print(f"| {fraction} | {name} | {' | '.join(cells)} | {100 * whole['value']:.1f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
