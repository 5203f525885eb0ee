"""Run a study: .venv/bin/python tests/proofs/studies NAME [options]. Without a name: which there are."""

import sys
from pathlib import Path

from cyclopts import App

STUDIES = {  # module: its studies, each a function of its name, or of the name ``main`` where it is alone
    "bounds": ("gates", "impaction", "injection_or_resolved"),
    "collisions": ("collision_draws", "collision_speed", "crowding", "throughput"),
    "costs": ("cost_by_seed", "mpi_ranks", "plan_times", "sweep_speed", "threads", "time_resolved_cost"),
    "ends": ("domain", "locked_band", "vibrating_air", "wake_ends"),
    "flakes": ("chaff_alone", "flakes", "flakes_in_air", "kernels"),
    "laws": ("air_loading", "best_estimate", "labyrinth", "printed_form", "rebound", "settled_passes"),
    "search_gain": ("search_gain",),
    "target_error": ("target_error",),
    "three_dimensions": ("three_dimensions",),
    **{name: (name,) for name in ("deposition", "intervals", "kernel_speed", "robustness", "share_error")},
}

app = App(name="studies", help="Studies of wakeflow.", version_flags=[], result_action="return_value")
for module, names in STUDIES.items():
    for name in names:
        app.command(f"proofs.studies.{module}:{'main' if names == (module,) else name}", name=name)

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parents[2])  # where support and proofs are
    app()
