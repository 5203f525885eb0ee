"""The published values in ``published.toml``, by the scene that they belong to."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from proofs.airflow.measured import quantities
from wakeflow.core.errors import SceneError
from wakeflow.laws.best_estimate import WAKE_FAMILIES, blocked

STATUSES = ("read", "quoted", "unchecked")


@dataclass(frozen=True)
class Published:
    """A published number ``low`` .. ``high`` of a quantity. ``within``: relative deviation up to which it counts as
    met; None where it is only ``reported``, for the reason given there. ``base``: of a drag without walls, the least
    and the greatest base pressure coefficient that may go with it.
    """

    quantity: str
    low: float
    high: float
    source: str
    status: str
    within: float | None = None
    reported: str = ""
    base: tuple[float, float] | None = None

    def between_walls(self, blockage: float) -> Published:
        """A drag without walls as it would be where the body blocks a channel by ``blockage``, by Maskell's rule
        (:func:`wakeflow.laws.best_estimate.blocked`); any other number as it is.
        """
        if self.base is None:
            return self
        drags = [blocked(drag, base, blockage)[0] for drag in (self.low, self.high) for base in self.base]
        without = f"{self.low:g}" if self.low == self.high else f"{self.low:g} to {self.high:g}"
        said = f"{self.source}: {without} without walls, here at {100 * blockage:.3g} % blockage by Maskell's rule"
        return replace(self, low=min(drags), high=max(drags), source=said, base=None)

    def checked(self, quantity: str | None) -> bool:
        """Whether this is a number of ``quantity`` that was read, here or by others."""
        return self.quantity == quantity and self.status != "unchecked"

    def deviation(self, value: float) -> float:
        """Relative distance of ``value`` from the nearer end, negative below; 0 inside the range."""
        nearest = min(max(value, self.low), self.high)
        return (value - nearest) / abs(nearest)


@dataclass(frozen=True)
class Case:
    """A verification case: a scene ``cases/verify/NAME.toml`` and what is known of it (keys: published.toml)."""

    name: str
    title: str
    values: tuple[Published, ...] = ()
    quick: bool = False
    alone: bool = False
    scales: tuple[float, ...] = (1.0,)
    order: Mapping[str, float] = field(default_factory=dict)
    beside: str | None = None
    closer: str | None = None
    between: str | None = None
    blend: str | None = None
    note: str = ""

    def between_walls(self, blockage: float) -> Case:
        """The case with every published number as it would be at that blockage."""
        return replace(self, values=tuple(value.between_walls(blockage) for value in self.values))


def verification_scenes() -> dict[str, Path]:
    """The scenes whose airflow is compared with published values, by name."""
    return {path.stem: path for path in sorted((Path(__file__).parents[3] / "cases" / "verify").glob("*.toml"))}


@cache
def cases() -> dict[str, Case]:
    """Every case of ``published.toml`` by name, in its sequence."""
    return read_cases(tomllib.loads((Path(__file__).parent / "published.toml").read_text(encoding="utf-8")))


def read_cases(tables: Mapping[str, Mapping[str, Any]]) -> dict[str, Case]:
    """The cases in plain tables. Raises SceneError for an entry that does not follow the rules at the head of
    published.toml.
    """
    return {name: _case(name, dict(table)) for name, table in tables.items()}


def _case(name: str, table: dict[str, Any]) -> Case:
    values = tuple(_published(name, row) for row in table.pop("value", []))
    if "scales" in table:
        table["scales"] = tuple(table["scales"])
    try:
        case = Case(name=name, values=values, **table)
    except TypeError as problem:
        raise SceneError(f"published.toml: {name}: {problem}") from None
    for quantity in (case.closer, case.between, *case.order):
        if quantity is not None and quantity not in quantities:
            raise SceneError(f"published.toml: {name}: unknown quantity {quantity!r}")
    for key in ("closer", "between"):
        quantity = getattr(case, key)
        if quantity is not None and (case.beside is None or not any(v.checked(quantity) for v in values)):
            raise SceneError(f"published.toml: {name}: {key} needs beside and a checked value of {quantity}")
    if case.blend is not None and (case.beside is None or case.blend not in WAKE_FAMILIES):
        raise SceneError(f"published.toml: {name}: blend needs beside, and is one of {', '.join(WAKE_FAMILIES)}")
    return case


def _published(name: str, row: Mapping[str, Any]) -> Published:
    known = {"quantity", "value", "low", "high", "within", "reported", "source", "status", "base"}
    low, high = row.get("low", row.get("value")), row.get("high", row.get("value"))
    wrong = (
        f"unknown keys {sorted(set(row) - known)}" if set(row) - known
        else f"unknown quantity {row.get('quantity')!r}" if row.get("quantity") not in quantities
        else "needs value, or low and high" if low is None or high is None or not low <= high
        else f"status {row.get('status')!r}: one of {', '.join(STATUSES)}" if row.get("status") not in STATUSES
        else "needs a source" if not row.get("source")
        else f"{row['quantity']} needs either within or reported, the reason why it is not judged"
        if ("within" in row) == bool(row.get("reported"))
        else "base: of a drag without walls, two base pressure coefficients below 0, the lower first"
        if "base" in row and not (row["quantity"] == "cd" and len(row["base"]) == 2 and sorted(row["base"])[1] < 0)
        else None
    )  # fmt: skip
    if wrong:
        raise SceneError(f"published.toml: {name}: {wrong}")
    judged = {key: row[key] for key in ("within", "reported") if key in row}
    judged |= {"base": tuple(row["base"])} if "base" in row else {}
    return Published(row["quantity"], float(low), float(high), source=row["source"], status=row["status"], **judged)
