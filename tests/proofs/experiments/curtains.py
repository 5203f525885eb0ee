"""Curtains of ceramic beads that fall through a room's air and drag it along: how fast they are, how thick they grow.

Read in the abstract: beads of 697 um, five flows from 1 to 22 kg/s per metre of curtain, all of which "approached a
terminal velocity of about 6-7 m/s in a vertical drop distance of 3 m" (Kim, Siegel, Kolb, Rangaswamy & Moujaes 2009,
Solar Energy 83, 1784). Density and slots are not in it: 3300 kg/m3 is that of such beads (3200 to 3560), and the slot
t that lets a flow through is that of models of solar receivers, (62/60) phi rho sqrt(g) (t - 1.4 d)^1.5 with phi 0.6,
as is the growth of the thickness by 8.7 mm a metre (Oles & Jackson 2015, Solar Energy, eq. 18, as quoted in them). The
beads do not meet here.

Ash in a box that is open at its top and bottom, in a stream about 0.1 m wide: together it falls "up to 4 times" as fast
as alone at a volume share of about 1e-3 (Del Bello et al. 2017, Sci. Rep. 7, 39620). Neither its sizes nor the height
of the box could be read, so these numbers are chosen, and the ratio is reported, no gate.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from proofs.report import Report, Row, Table, Tell
from wakeflow.laws.constants import GRAVITY, STANDARD_AIR
from wakeflow.laws.drag import terminal_velocity
from wakeflow.runs import run
from wakeflow.scene import Scene

SOURCE = "Kim, Siegel, Kolb, Rangaswamy & Moujaes 2009, Solar Energy 83, 1784 (abstract read)"
MEASURED, ABOUT = (6.0, 7.0), 0.5  # m/s after 3 m at every flow, and what "about" allows on either side; chosen
FLOWS = (1.0, 5.0, 22.0)  # kg/(s m)
SIZE, DENSITY, PACKED = 697e-6, 3300.0, 0.6  # m, kg/m3, solid volume in the slot
DROPS = (1.0, 2.0, 3.0)  # m
SQUARE = 12.0**0.5  # thickness of a uniform curtain over the standard deviation of its places


def key(drop: float) -> str:
    """Of what is found after a ``drop`` (m), in a row."""
    return f"at_{1000.0 * drop:.0f}_mm"


COLUMNS = {
    "flow, kg/(s m)": "{flow:g}", "slot, mm": "{slot:.1f*1000}", "air driven to, m/s": "{air:.1f}",
    **{f"after {drop:g} m, m/s": f"{{{key(drop)}:.2f}}" for drop in DROPS}, "after 3 m in air at rest": "{alone:.2f}",
    "measured": "about 6 to 7", "met": "{met:yes|NO}",
    "thickness grows by, mm a metre": "{grows:.1f*1000}", "in receiver models": "8.7",
}  # fmt: skip


def curtain(flow: float, count: int) -> Scene:
    """A room 4 m wide in which a curtain of so much falls 3 m."""
    slot = (60.0 * flow / (62.0 * PACKED * DENSITY * GRAVITY**0.5)) ** (1.0 / 1.5) + 1.4 * SIZE
    tables: dict[str, Any] = {
        "channel": {"width": 4.0, "top": 0.1, "bottom": -3.01},
        "air": {"speed": 0.0},
        "feed": {
            "level": 0.0, "speed": flow / (PACKED * DENSITY * slot), "width": slot, "rate": flow, "count": count,
        },
        "fraction": {"bead": {"size": SIZE, "density": DENSITY, "restitution": 0.6, "friction": 0.3}},
        "bin": {"floor": {"from": -2.0, "to": 2.0}},
        "picture": {"levels": {"kind": "levels", "levels": [-drop for drop in DROPS]}},
    }  # fmt: skip
    return Scene.parse(tables)


def run_curtains(folder: Path, tell: Tell = lambda _: None, count: int = 256) -> Report:
    """Of all flows."""
    rows: list[Row] = []
    for flow in FLOWS:
        tell(f"a curtain of {flow:g} kg/(s m)")
        scene = curtain(flow, count)
        driven, rest = (
            run(scene, folder / f"curtain-{flow:g}-{how}", force={"collisions": False, "air-loading": how == "driven"})
            for how in ("driven", "rest")
        )
        speed, spread = _passing(driven, "vy"), _passing(driven, "spread")
        last = -speed[DROPS[-1]]
        rows.append({
            "case": "curtain", "flow": flow, "slot": scene.feed.width, "air": driven.airflow.loading.speed,
            **{key(drop): -speed[drop] for drop in DROPS}, "alone": -_passing(rest, "vy")[DROPS[-1]],
            "met": MEASURED[0] - ABOUT <= last <= MEASURED[1] + ABOUT,
            "grows": (SQUARE * spread[DROPS[-1]] - scene.feed.width) / DROPS[-1], "source": SOURCE,
        })  # fmt: skip
    missed = [f"curtain of {row['flow']:g} kg/(s m)" for row in rows if not row["met"]]
    table = Table("curtains of beads that drive a room's air", COLUMNS, rows)
    return Report("curtains", [table], {"rows": rows}, [SOURCE], missed)


ASH = "Del Bello et al. 2017, Sci. Rep. 7, 39620 (abstract read)"
ASH_SIZES, ASH_DENSITY, SHARE, STREAM = (125e-6, 250e-6, 500e-6), 2700.0, 1e-3, 0.1  # m, kg/m3, volume, m; chosen
ASH_DROPS = (0.5, 1.0)  # m; chosen
ASH_COLUMNS = {
    "ash, um": "{size:.0f*1e6}", "alone, m/s": "{alone:.2f}",
    **{f"together, times as fast after {drop:g} m": f"{{{key(drop)}:.1f}}" for drop in ASH_DROPS},
    "measured": "up to 4",
}  # fmt: skip


def ash(size: float, count: int) -> Scene:
    """A stream of ash that comes as fast as it falls alone, and fills so much of the volume."""
    alone = float(terminal_velocity(size, ASH_DENSITY, *STANDARD_AIR, GRAVITY, "brown-lawler"))
    tables: dict[str, Any] = {
        "channel": {"width": 2.0, "top": 0.1, "bottom": -1.01},
        "air": {"speed": 0.0},
        "feed": {
            "level": 0.0, "speed": alone, "width": STREAM, "rate": SHARE * ASH_DENSITY * alone * STREAM, "count": count,
        },
        "fraction": {"ash": {"size": size, "density": ASH_DENSITY, "restitution": 0.5, "friction": 0.4}},
        "bin": {"floor": {"from": -1.0, "to": 1.0}},
        "picture": {"levels": {"kind": "levels", "levels": [-drop for drop in ASH_DROPS]}},
    }  # fmt: skip
    return Scene.parse(tables)


def run_ash(folder: Path, tell: Tell = lambda _: None, count: int = 256) -> Report:
    """Of all sizes."""
    rows: list[Row] = []
    for size in ASH_SIZES:
        tell(f"ash of {1e6 * size:g} um")
        scene, place = ash(size, count), folder / f"ash-{1e6 * size:.0f}"
        found = run(scene, place, force={"collisions": False, "air-loading": True})
        speed, alone = _passing(found, "vy"), float(scene.feed.fall_speed)
        faster = {key(drop): -speed[drop] / alone for drop in ASH_DROPS}
        rows.append({"case": "ash", "size": size, "alone": alone, **faster, "source": ASH})
    return Report("ash", [Table("ash that falls together", ASH_COLUMNS, rows)], {"rows": rows}, [ASH], [])


def _passing(found: Any, quantity: str) -> dict[float, float]:
    """The mean of a quantity of the only fraction after each drop (m)."""
    numbers = found.pictures["levels"].numbers
    pairs = zip(numbers["levels"], *numbers["fractions"].values(), strict=True)
    return {-level: row[quantity][0] for level, row in pairs}
