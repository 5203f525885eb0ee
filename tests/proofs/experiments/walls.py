"""Dust on walls: how fast turbulence lays it there, and how it gets through a duct (``proofs.studies.deposition``)."""

from __future__ import annotations

from proofs.report import Report, Row, Table, Tell
from proofs.studies.deposition import COLUMNS, CURVE, DUCT_COLUMNS, DUCTS, FROM, SIZES, rows, through


def run_walls(tell: Tell = lambda _: None, count: int = 500) -> Report:
    """V+ on two meshes against a measured curve and measured ducts; dust of three sizes through a duct."""
    tell("dust on walls")
    laid: list[Row] = list(rows(count))
    duct: list[Row] = [through(size, count) for size in SIZES]
    missed = [f"deposition, {row['mesh']}, tau+ {row['tau']:g}, {row['by']}" for row in laid if not row["met"]]
    missed += [f"duct, {row['size']:g} m" for row in duct if row["met"] is False]
    tables = [Table("dust on walls", COLUMNS, laid), Table("dust through a duct", DUCT_COLUMNS, duct)]
    return Report("walls", tables, {"rows": laid, "duct": duct}, [], missed)


def spans(laid: list[Row]) -> dict[str, tuple[float, float]]:
    """Least and largest V+ over the measured one where granules are heavy enough to be laid, by whom."""
    over = {by: [row["over"] for row in laid if row["by"] == by and row["tau"] >= FROM] for by in (CURVE, DUCTS)}
    return {by: (min(found), max(found)) for by, found in over.items()}
