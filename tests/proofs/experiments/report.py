"""``wakeflow verify measured``: experiments with granules next to what is computed of them."""

from __future__ import annotations

from pathlib import Path

from proofs.experiments.droplets import run_droplets
from proofs.experiments.rebound import run_rebound
from proofs.experiments.suspension import run_suspension
from proofs.report import Report, Row, Table, Tell

SUMMARY = {"experiment": "{what}", "measured": "{measured}", "computed": "{computed}", "gate": "{gate}",
           "met": "{met}", "source": "{source}"}  # fmt: skip
NOT_COMPUTED: tuple[Row, ...] = (  # what was found in print and is not computed here, and why
    {"what": "curtain of 697 um ceramic, 1 to 22 kg/(s m)", "measured": "thickness + 8.7 mm a metre",
     "computed": None, "gate": "none: needs air that the granules alone drive",
     "source": "Oles & Jackson 2015, Solar Energy, eq. 18, as quoted in receiver models"},
    {"what": "ash that settles together", "measured": "up to 4 times as fast at a volume share of 1e-3",
     "computed": None, "gate": "none: needs air that the granules alone drive",
     "source": "Del Bello et al. 2017, Sci. Rep. 7, 39620 (abstract read)"},
    {"what": "dust of 13 to 96 um in the near wake of a disc", "measured": "kept shorter the larger its Stokes number",
     "computed": None, "gate": "none: the numbers were not found, and a disc is no plane body",
     "source": "Sato, Vincent & Pui 1996, J. Aerosol Sci. 27, 559 (abstract read)"},
)  # fmt: skip


def run_measured(folder: Path, *, slow: bool = False, tell: Tell = lambda _: None) -> Report:
    """All experiments that can be computed; ``slow``: with more granules. What cannot is listed, and why."""
    rebound, leg = run_rebound(tell), run_suspension(folder, tell, 4096 if slow else 256)
    wet = run_droplets(folder, tell, 4096 if slow else 1024)
    parts = (rebound, leg, wet)
    rows = [_rebound(rebound), _suspension(leg), _droplets(wet), *({**row, "met": None} for row in NOT_COMPUTED)]
    facts = {"rows": rows, **{part.name: part.facts["rows"] for part in parts}}
    tables = [Table("measured and computed", SUMMARY, rows), *(table for part in parts for table in part.tables)]
    notes, missed = ([line for part in parts for line in getattr(part, name)] for name in ("notes", "missed"))
    return Report("measured", tables, facts, notes, missed)


def _rebound(found: Report) -> Row:
    rows = found.facts["rows"]
    worst = max(rows, key=lambda row: abs(row["off"]))
    return {
        "what": "first rebound of hard spheres, 2 to 85 deg", "measured": "11 angles",
        "computed": f"within {abs(worst['off']):.2f} deg (at {worst['theta']:g} deg)",
        "gate": "0.4 deg from 30 deg on, 0.9 everywhere", "met": _word(found), "source": worst["source"],
    }  # fmt: skip


def _suspension(found: Report) -> Row:
    rows = found.facts["rows"]
    parted = [row["speed"] for row in rows if row["internodes"] > 0.98 and row["nodes"] < 0.02]
    return {
        "what": "straw nodes and internodes in upward air", "measured": "part between 3.58 and 4.62 m/s",
        "computed": f"part fully at {', '.join(f'{one:g}' for one in parted)} m/s",
        "gate": "98 % on the measured side", "met": _word(found), "source": rows[0]["source"],
    }  # fmt: skip


def _droplets(found: Report) -> Row:
    rows = found.facts["rows"]
    below = {
        body: [100.0 * (row["theory"] - row["kept"].value) for row in rows if row["body"] == body]
        for body in ("cylinder", "ribbon")
    }
    told = ", ".join(f"{body} {min(points):.0f} to {max(points):.0f}" for body, points in below.items())
    return {
        "what": "droplets of 20 to 40 um on a cylinder and a ribbon, 2 to 6 m/s",
        "measured": "slightly below theory, ribbons much below", "computed": f"points below ideal flow: {told}",
        "gate": "below; cylinders by at most 15 points (chosen)", "met": _word(found), "source": rows[0]["source"],
    }  # fmt: skip


def _word(found: Report) -> str:
    return "NO" if found.missed else "yes"
