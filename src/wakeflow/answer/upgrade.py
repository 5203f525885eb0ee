"""Results of earlier versions: what schema 1 of result.json held, as schema 2 holds it."""

from __future__ import annotations

from ..core.record import JsonMapping, JsonTable, columns
from ..planning.airflow import AirflowPlan

Table = JsonTable


def upgraded(table: JsonMapping) -> Table:
    """A result.json of any schema, as the present one holds it."""
    made = dict(table)
    if made.get("schema") != 1:
        return made
    made |= {"schema": 2, "plan": _plan(made["plan"]), "mesh": made.get("mesh") or None}
    if made.get("airflow"):
        made["airflow"] = {**made["airflow"], "statistics": made["airflow"].get("statistics") or None}
    if "budget" in made:
        made["budget"] = [{"unit": None, **row} for row in made["budget"]]
    for name in ("separation", "without_collisions"):
        if made.get(name):
            made[name] = _separation(made[name])
    return made


def _plan(old: Table) -> Table:
    """The airflow has a table of its own, and warnings with their grades are notices."""
    keys = [one.key for one in columns(AirflowPlan)]
    airflow = {"symmetric": False, "half": False} | {key: old[key] for key in keys if old.get(key) is not None}
    airflow = dict.fromkeys(("stepping", "turbulence")) | {"why": ""} | airflow
    said = zip(old.get("grades") or (), old.get("warnings") or (), strict=False)
    rest = {key: value for key, value in old.items() if key not in (*keys, "grades", "warnings", "flown_by")}
    rest |= {"notices": [{"grade": grade, "text": text} for grade, text in said], "airflow": airflow}
    rest["validity"] = rest.get("validity") or []
    return rest


def _separation(old: Table) -> Table:
    """The value of a share has the name of all values."""
    shares = {
        name: {
            place: {"value": row["share"], **{k: row[k] for k in row if k != "share"}} for place, row in rows.items()
        }
        for name, rows in old["fractions"].items()
    }
    # a purity or recovery that could not be measured is none
    recovery = {name: None if row is None or row["value"] is None else row for name, row in old["recovery"].items()}
    return {**old, "fractions": shares, "recovery": recovery}
