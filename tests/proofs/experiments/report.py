"""``wakeflow verify measured``: experiments with granules next to what is computed of them."""

from __future__ import annotations

from pathlib import Path

from proofs.experiments.catch import run_catch
from proofs.experiments.curtains import key, run_ash, run_curtains
from proofs.experiments.droplets import run_droplets
from proofs.experiments.grid import run_grid
from proofs.experiments.near_wake import LEVEL, run_near_wake
from proofs.experiments.rebound import run_rebound
from proofs.experiments.sheets import run_sheets
from proofs.experiments.step import run_step
from proofs.experiments.suspension import run_suspension
from proofs.experiments.walls import run_walls, spans
from proofs.report import Report, Row, Table, Tell

SUMMARY = {"experiment": "{what}", "measured": "{measured}", "computed": "{computed}", "gate": "{gate}",
           "met": "{met}", "source": "{source}"}  # fmt: skip


def run_measured(folder: Path, *, slow: bool = False, tell: Tell = lambda _: None) -> Report:
    """All experiments that can be computed; ``slow``: with more granules, and a finer airflow."""
    blown = run_sheets(tell)
    rebound, leg = run_rebound(tell), run_suspension(folder, tell, 4096 if slow else 256)
    cloud = run_catch(folder, tell, 16384 if slow else 8192)
    wet = run_droplets(folder, tell, 4096 if slow else 1024)
    falling = run_curtains(folder, tell, 4096 if slow else 256)
    settling = run_ash(folder, tell, 4096 if slow else 256)
    kept = run_near_wake(tell, 4096 if slow else 1024, 1.0 if slow else 1.5)
    behind = run_grid(tell, 16384 if slow else 4096)
    laid = run_walls(tell, 2000 if slow else 500)
    parted = run_step(tell)
    parts = (cloud, blown, rebound, leg, wet, falling, settling, kept, behind, laid, parted)
    rows = [
        *_catch(cloud), *_sheets(blown), _rebound(rebound), _suspension(leg), _droplets(wet), _curtains(falling),
        _ash(settling), _near_wake(kept), _grid(behind), _walls(laid),
        _step(parted),
    ]  # fmt: skip
    rows.sort(key=lambda row: row["met"] != "NO")  # what misses is said first
    facts = {"rows": rows, **{part.name: part.facts["rows"] for part in parts}}
    tables = [Table("measured and computed", SUMMARY, rows), *(table for part in parts for table in part.tables)]
    notes, missed = ([line for part in parts for line in getattr(part, name)] for name in ("notes", "missed"))
    return Report("measured", tables, facts, notes, missed)


def _catch(found: Report) -> list[Row]:
    return [
        {
            "what": row["title"], "measured": row["gate"], "met": "yes" if row["met"] else "NO",
            "computed": f"{row['kept']:.3f} ({row['low']:.3f} to {row['high']:.3f})", "gate": "that error",
            "source": row["source"],
        }
        for row in found.facts["rows"] if row["gate"] is not None
    ]  # fmt: skip


def _sheets(found: Report) -> list[Row]:
    rows = found.facts["rows"]
    pieces = {row["piece"]: [one for one in rows if one["piece"] == row["piece"]] for row in rows}
    return [
        {
            "what": f"{piece} in a level wind, the drag of its fall: way over that measured",
            "measured": "1, K " + ", ".join(f"{row['number']:g}" for row in of_piece),
            "computed": ", ".join(f"{row['worst']:.2f}" for row in of_piece) + " at worst",
            "gate": f"{of_piece[0]['gate']} (chosen)", "source": of_piece[0]["source"],
            "met": "yes" if all(row["met"] for row in of_piece) else "NO",
        }
        for piece, of_piece in pieces.items()
    ]  # fmt: skip


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
        "gate": "below; cylinders by at most 10 points (chosen)", "met": _word(found), "source": rows[0]["source"],
    }  # fmt: skip


def _curtains(found: Report) -> Row:
    rows = found.facts["rows"]
    told, flows = (
        ", ".join(f"{row[name]:{form}}" for row in rows) for name, form in ((key(3.0), ".1f"), ("flow", "g"))
    )
    return {
        "what": f"curtain of 697 um beads, {flows} kg/(s m), after 3 m",
        "measured": "about 6 to 7 m/s", "computed": f"{told} m/s; {rows[0]['alone']:.1f} in air at rest",
        "gate": "5.5 to 7.5 (chosen)", "met": _word(found), "source": rows[0]["source"],
    }  # fmt: skip


def _ash(found: Report) -> Row:
    rows = found.facts["rows"]
    told, sizes = (", ".join(f"{by * row[name]:{form}}" for row in rows) for name, by, form in (
        (key(1.0), 1.0, ".1f"), ("size", 1e6, ".0f"),
    ))  # fmt: skip
    return {
        "what": "ash that falls together, 1e-3 of the volume", "measured": "up to 4 times as fast as alone",
        "computed": f"{told} times after 1 m ({sizes} um)", "gate": "none: its sizes were not found", "met": None,
        "source": rows[0]["source"],
    }  # fmt: skip


def _near_wake(found: Report) -> Row:
    rows = found.facts["rows"]
    stays = {row["stokes"]: row["stay"].value for row in rows}
    fine, heavy = stays[min(stays)], [stay for stokes, stay in stays.items() if stokes >= LEVEL]
    return {
        "what": "dust in a near wake: H = tau U / D (measured behind a disc, computed behind a plate)",
        "measured": "falls with the Stokes number, level above 1",
        "computed": f"{fine:.1f} of fine dust, {min(heavy):.1f} to {max(heavy):.1f} from Stokes numbers of 1 on",
        "gate": "below the fine dust's interval; level to a quarter of that (chosen)", "met": _word(found),
        "source": rows[0]["source"],
    }  # fmt: skip


def _grid(found: Report) -> Row:
    last = found.facts["rows"][-1]
    return {
        "what": f"beads of hollow glass behind a grid, mean square sideways after {last['time']:.2f} s",
        "measured": f"{last['measured']:.1f} cm2",
        "computed": f"{last['law']:.1f} cm2; {last['shortest']:.1f} to {last['longest']:.1f} over eddies' lifetimes",
        "gate": "the shortest lifetime within 20 % from 0.09 s on (chosen)", "met": _word(found),
        "source": last["source"],
    }  # fmt: skip


def _walls(found: Report) -> Row:
    told = spans(found.facts["rows"])
    return {
        "what": "dust of tau+ 1 to 100 laid on a wall by turbulence: V+ over the measured one", "measured": "1",
        "computed": "; ".join(f"{low:.2g} to {high:.2g} ({by})" for by, (low, high) in told.items()),
        "gate": "a factor of 3 of the curve, which the damping was chosen on; of 4 of the ducts, which it was not",
        "met": _word(found),
        "source": "Liu & Agarwal 1974, J. Aerosol Sci. 5, 145; Sippola & Nazaroff 2002 (both as quoted by others)",
    }  # fmt: skip


def _step(found: Report) -> Row:
    developed, meets, *profiles = found.facts["rows"]
    off = [row["computed"] for row in profiles]
    return {
        "what": "air alone behind a step on a channel's wall, Re 18 600: where it meets the wall, and five profiles",
        "measured": f"{meets['measured']:g} step heights; centre line over mean before it {developed['measured']:.3f}",
        "computed": f"{meets['computed']:.1f}; {developed['computed']:.3f}; profiles off by {min(off):.2f} to "
        f"{max(off):.2f} of the centre line's (rms)",
        "gate": f"{meets['gate']}; profiles {profiles[0]['gate']}", "met": _word(found), "source": meets["source"],
    }  # fmt: skip


def _word(found: Report) -> str:
    return "NO" if found.missed else "yes"
