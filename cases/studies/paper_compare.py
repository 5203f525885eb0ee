"""Print where each fraction lands behind the plain rhombus, with an additional air stream, and with a barrier:

.venv/bin/python cases/studies/paper_compare.py [options of wakeflow run, such as --set numerics.mesh_scale=2]

Steady airflows (rung draft). Runs what has not been run yet; results in runs/paper.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from wakeflow.cli import main as wakeflow

CASES = Path(__file__).parents[1]
SCENES = {
    "plain": CASES / "rhombus.toml",
    "air stream": CASES / "paper" / "air-stream.toml",
    "barrier": CASES / "paper" / "barrier.toml",
}


def main(options: list[str]) -> int:
    """Run the scenes with ``options`` and print the table; the exit code of a run that failed, else 0."""
    tables = {}
    for name, scene in SCENES.items():
        out = Path("runs", "paper", scene.stem)
        code = wakeflow(["run", str(scene), "--out", str(out), "--rung", "draft", "--quiet", *options])
        if code:
            return code
        tables[name] = json.loads((out / "result.json").read_text())["separation"]
    bins, fractions = tables["plain"]["bins"], tables["plain"]["fractions"]
    print(f"| fraction | scene | {' | '.join(bins)} | recovery |")
    print(f"| --- | --- |{' ---: |' * (len(bins) + 1)}")
    for fraction in fractions:
        for name, table in tables.items():
            row, whole = table["fractions"][fraction], table["recovery"][fraction]
            cells = [f"{100 * row[place]['value']:.1f}" for place in bins]
            half = 50 * (whole["high"] - whole["low"])
            print(f"| {fraction} | {name} | {' | '.join(cells)} | {100 * whole['value']:.1f} ± {half:.1f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
