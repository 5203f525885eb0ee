"""Dust in the near wake of a plate: the larger its Stokes number, the shorter the wake keeps it.

Sato, Vincent & Pui 1996, J. Aerosol Sci. 27, 559 (abstract read): dust of 13 to 96 um in the near wake of a disc,
Stokes numbers up to 8; H = t U / D falls steadily with the Stokes number, and levels off above 1. Their numbers were
not found, and a disc is no plane body. So the gate is the trend behind a plate, whose wake is computed in time: dust
of Stokes numbers from 1 on is kept shorter than fine dust, and all of it about as long.
"""

from __future__ import annotations

from collections.abc import Sequence

from proofs.airflow.residence import residence_time
from proofs.report import Report, Row, Table, Tell
from wakeflow.core.number import Number
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

SOURCE = "Sato, Vincent & Pui 1996, J. Aerosol Sci. 27, 559 (abstract read)"
WIDTH, SPEED = 0.03, 2.0  # m, m/s: Re 4000
STOKES = (3e-4, 0.1, 0.3, 1.0, 3.0, 8.0)  # tau_p U / D
LEVEL, ALIKE = 1.0, 0.25  # Stokes number from which on H is level, to that part of fine dust's; chosen
COLUMNS = {
    "Stokes number": "{stokes:g}", "H = tau U / D": "{stay.value:.2f} ({stay.low:.2f} to {stay.high:.2f})",
}  # fmt: skip


def plate(scale: float) -> Scene:
    """A plate across the air, with a fraction that nobody asks for."""
    half, thick = 0.5 * WIDTH, 0.05 * WIDTH
    points = [[-half, -thick], [half, -thick], [half, thick], [-half, thick]]
    return Scene.parse({
        "body": {"plate": {"shape": "polygon", "points": points}},
        "channel": {"width": 10.0 * WIDTH, "top": 6.0 * WIDTH, "bottom": -12.0 * WIDTH, "walls": "slip"},
        "air": {"speed": SPEED, "direction": "down"},
        "feed": {"height": WIDTH, "width": WIDTH, "count": 16},
        "fraction": {"dust": {"size": 1e-5, "density": 1000.0, "restitution": 0.0, "friction": 1.0}},
        "bin": {"floor": {"from": -5.0 * WIDTH, "to": 5.0 * WIDTH}},
        "numerics": {"mesh_scale": scale},
    })  # fmt: skip


def run_near_wake(tell: Tell = lambda _: None, count: int = 1024, scale: float = 1.5) -> Report:
    """Of all Stokes numbers, in one airflow."""
    tell("the wake of a plate, in time")
    scene = plate(scale)
    pipeline = Pipeline(scene, make_plan(scene, rung="standard"))
    air, (body,) = pipeline.air.realisations, scene.body.values()
    fields = [field for number in range(len(air)) if (field := air.make(number)) is not None]
    rows: list[Row] = []
    for stokes in STOKES:
        tell(f"dust of Stokes number {stokes:g} behind a plate")
        found = residence_time(
            fields, body.outline(), "down", SPEED, count=count, sheddings=air.cycles, stokes=stokes
        )  # fmt: skip
        stay = Number(found.value, found.low, found.high)
        rows.append({"case": "near wake", "stokes": stokes, "stay": stay, "source": SOURCE})
    table = Table("dust in the near wake of a plate", COLUMNS, rows)
    return Report("near-wake", [table], {"rows": rows}, [SOURCE], missed([row["stay"] for row in rows]))


def missed(stays: Sequence[Number]) -> list[str]:
    """What the residence times, by STOKES, do not do that was measured."""
    fine, *_ = stays
    heavy = [stay.value for stay, stokes in zip(stays, STOKES, strict=True) if stokes >= LEVEL]
    falls, level = max(heavy) < fine.low, max(heavy) - min(heavy) < ALIKE * fine.value
    return [*([] if falls else ["heavy dust is kept as long as fine dust"]), *([] if level else ["H is not level"])]
