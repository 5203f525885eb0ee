"""Run a study: .venv/bin/python tests/proofs/studies NAME [options]. Without a name: which there are."""

import sys
from pathlib import Path

from cyclopts import App

HERE = Path(__file__).parent
NO_STUDY = ("__init__", "__main__", "common", "compared_flights")

app = App(name="studies", help="Studies of wakeflow.", version_flags=[], result_action="return_value")
for path in sorted(HERE.glob("*.py")):
    if path.stem not in NO_STUDY:
        app.command(f"proofs.studies.{path.stem}:main", name=path.stem)

if __name__ == "__main__":
    sys.path[0] = str(HERE.parents[1])  # where support and proofs are
    app()
