"""[[measured]]: what was weighed or counted in the trays of a real machine, in a scene or as a CSV file.

A row is one tray: its ``bin``, the ``fraction`` that was sorted out of it (none: the tray was weighed as it is, all
fractions together), and the ``share`` of that fraction's mass in it, or the ``mass`` or the ``count`` of granules that
lay there. An uncertainty is half of a 95 % interval, as everywhere.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from ..core.errors import SceneError
from ..core.files import path_of
from ..core.number import Number
from ..core.quantities import split_quantity
from ..core.registry import did_you_mean
from .table import SHARE, Name, Table
from .uncertainty import SIGMAS

Array = NDArray[np.float64]
AMOUNTS = ("share", "mass", "count")  # of which a row gives one
HEADS = ["fraction", "bin", *AMOUNTS, "uncertainty"]
BY_CHANCE = 0.5  # granules that are added to each counted tray where its chance is judged (Jeffreys' prior)
EXAMPLE = "fraction,bin,share,uncertainty"


class Tray(Table):
    """One tray: what lay in it. Give ``share``, ``mass`` or ``count``."""

    bin: Name = Field(description="that the tray is, or elsewhere")
    fraction: Name | None = Field(None, description="that was sorted out of it; without one the tray was not sorted")
    share: Annotated[float, Field(ge=0, le=1), SHARE] | None = Field(
        None, description="of the fraction's mass, or of the whole feed's where the tray was not sorted"
    )
    mass: Annotated[float, Field(ge=0)] | None = Field(None, description="in any unit, the same for all trays")
    count: Annotated[int, Field(ge=0)] | None = Field(None, description="granules, of every tray of the fraction")
    uncertainty: Annotated[float, Field(ge=0), SHARE] | None = Field(
        None, description="half of the 95 % interval of the share or mass; of a count only what is beyond chance"
    )

    @model_validator(mode="after")
    def _one_amount(self) -> Tray:
        given = [name for name in AMOUNTS if getattr(self, name) is not None]
        if len(given) != 1:
            raise SceneError(f"{self.about}: give share, mass or count, one of them")
        if given != ["count"] and not self.uncertainty:
            raise SceneError(f"{self.about}: give its uncertainty, half of the 95 % interval, above 0")
        return self

    @property
    def amount(self) -> str:
        """Which of share, mass and count it gives."""
        return next(name for name in AMOUNTS if getattr(self, name) is not None)

    @property
    def about(self) -> str:
        """The tray in words."""
        return f"{self.fraction or 'all fractions'} in {self.bin}"


@dataclass(frozen=True)
class Measured:
    """Shares that were measured: of each tray its ``fraction`` (None: of the whole feed) and ``bin``, the ``shares``
    (n,) and their ``covariance`` (n, n), of which counted trays of one fraction have one.
    """

    places: tuple[tuple[str | None, str], ...]
    shares: Array
    covariance: Array

    @classmethod
    def of(cls, trays: Sequence[Tray]) -> Measured:
        """What ``trays`` say. Raises SceneError where one fraction is given in two ways, or nothing was found of it."""
        shares, covariance = np.zeros(len(trays)), np.zeros((len(trays), len(trays)))
        for name in dict.fromkeys(tray.fraction for tray in trays):
            mine = [place for place, tray in enumerate(trays) if tray.fraction == name]
            found, spread = _of_fraction([trays[place] for place in mine])
            shares[mine] = found
            covariance[np.ix_(mine, mine)] = spread
        return cls(tuple((tray.fraction, tray.bin) for tray in trays), shares, covariance)

    def numbers(self) -> list[Number]:
        """Each share with its 95 % interval."""
        halves = SIGMAS * np.sqrt(np.diag(self.covariance))
        low, high = np.maximum(self.shares - halves, 0.0), np.minimum(self.shares + halves, 1.0)
        ends = zip(self.shares, low, high, strict=True)
        return [Number(*map(float, one)) for one in ends]

    def weights(self, known: Sequence[tuple[str, str]], mass: Mapping[str, float]) -> Array:
        """What each tray (n,) holds of the shares ``known`` (S,) by fraction and bin; ``mass``: share of every fraction
        in the feed, which trays that were not sorted are made of.

        Raises SceneError for a tray of a fraction or bin that there is not.
        """
        made = np.zeros((len(self.places), len(known)))
        for row, (fraction, place) in enumerate(self.places):
            check_names(fraction, place, known)
            for column, (name, bin_) in enumerate(known):
                if bin_ == place and fraction in (None, name):
                    made[row, column] = 1.0 if fraction == name else mass[name]
        return made


def check_names(fraction: str | None, place: str, known: Sequence[tuple[str, str]]) -> None:
    """Raise SceneError where a tray is of a fraction or bin that is not in ``known``."""
    for kind, name, names in (
        ("fraction", fraction, list(dict.fromkeys(name for name, _ in known))),
        ("bin", place, list(dict.fromkeys(bin_ for _, bin_ in known))),
    ):
        if name is not None and name not in names:
            raise SceneError(f"measured: no {kind} {name!r}{did_you_mean(name, names)} (known: {', '.join(names)})")


def _of_fraction(trays: Sequence[Tray]) -> tuple[Array, Array]:
    """Shares (n,) and covariance (n, n) of the trays of one fraction."""
    amounts = {tray.amount for tray in trays}
    if len(amounts) > 1:
        raise SceneError(f"measured: {trays[0].about}: give all trays of it as {' or as '.join(sorted(amounts))}")
    amount = amounts.pop()
    found = np.array([float(getattr(tray, amount)) for tray in trays])
    own = np.array([(tray.uncertainty or 0.0) / SIGMAS for tray in trays])
    if amount == "share":
        return found, np.diag(own**2)
    total = float(found.sum())
    if total <= 0.0:
        raise SceneError(f"measured: {trays[0].about}: nothing lay in any tray of it")
    shares = found / total
    if amount == "mass":  # each share is of the sum of all trays, which the masses move together
        slope = (np.eye(len(found)) - shares[:, None]) / total
        return shares, slope @ np.diag(own**2) @ slope.T
    chance = (found + BY_CHANCE) / (found + BY_CHANCE).sum()
    return shares, (np.diag(chance) - np.outer(chance, chance)) / total + np.diag(own**2)


# -- The file ----------------------------------------------------------------------------------------------------------
def read_trays(path: Path | str) -> list[Tray]:
    """The trays of a CSV file: a line a tray under the heads fraction, bin, uncertainty and share, mass or count, in
    any order; cells are separated by commas, semicolons or tabs, lines that begin with # are notes.

    Raises SceneError, one line that names the line of the file, for what cannot be read.
    """
    file = path_of(path, "measured")
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        why = problem.strerror if isinstance(problem, OSError) else "not a text file"
        raise SceneError(f"measured: cannot read {file}: {why}") from None
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"]
    if not rows:
        raise SceneError(f"measured: {file.name} is empty; its first line is {EXAMPLE}")
    mark = next((mark for mark in (";", "\t", ",") if mark in rows[0][1]), ",")
    heads = [head.strip().lower() for head in next(csv.reader([rows[0][1]], delimiter=mark))]
    _check_heads(heads, file.name)
    found = [_tray(heads, next(csv.reader([line], delimiter=mark)), f"{file.name}, line {n}") for n, line in rows[1:]]
    if not found:
        raise SceneError(f"measured: {file.name} holds no tray; write one a line: wheat,middle,0.12,0.02")
    return found


def _check_heads(heads: Sequence[str], name: str) -> None:
    unknown = [head for head in heads if head not in HEADS]
    if unknown:
        raise SceneError(
            f"measured: {name}: head {unknown[0]!r} is unknown{did_you_mean(unknown[0], HEADS)}; the first line is "
            f"{EXAMPLE}, or has mass or count for share"
        )
    if "bin" not in heads or not set(AMOUNTS) & set(heads):
        raise SceneError(f"measured: {name}: lacks bin, or share, mass or count; its first line is {EXAMPLE}")


def _tray(heads: Sequence[str], cells: Sequence[str], at: str) -> Tray:
    """The tray of one line. Raises SceneError that names the line."""
    if len(cells) != len(heads):
        raise SceneError(f"measured: {at}: has {len(cells)} cells, its heads are {len(heads)}")
    table: dict[str, Any] = {head: cell.strip() for head, cell in zip(heads, cells, strict=True) if cell.strip()}
    if not set(AMOUNTS) & set(table):
        raise SceneError(f"measured: {at}: is not filled in; give its share, mass or count, or delete the line")
    for head in ("share", "mass", "count", "uncertainty"):
        if head in table:
            table[head] = _number(table[head], head, at)
    try:
        return Tray(**table)
    except ValidationError as problem:
        first = problem.errors()[0]
        what = "".join(f"{part} " for part in first["loc"])
        raise SceneError(f"measured: {at}: {what}{first['msg'].removeprefix('Value error, ')}") from None


def _number(text: str, head: str, at: str) -> float | int:
    """A cell as a number; a share or an uncertainty may be written in percent."""
    parts = split_quantity(text)
    if parts is not None and parts[1] == "%" and head in ("share", "uncertainty"):
        return 0.01 * parts[0]
    try:
        value = float(text)
    except ValueError:
        hint = f"; write a decimal point: {text.replace(',', '.')}" if "," in text else ""
        raise SceneError(f"measured: {at}: {head} = {text!r} is no number{hint}") from None
    if head == "count":
        if value != int(value):
            raise SceneError(f"measured: {at}: count = {text!r}: granules are counted in whole numbers")
        return int(value)
    if head == "share" and 1.0 < value <= 100.0:
        raise SceneError(f"measured: {at}: share = {text}: write a share from 0 to 1, or {text} %")
    return value


def trays_in(data: Mapping[str, object], base: Path) -> Mapping[str, object]:
    """The tables of a scene with the trays of the file ``measured`` in place of its name, so that results tell what
    was measured.
    """
    given = data.get("measured")
    if not isinstance(given, str):
        return data
    return {**data, "measured": [tray.model_dump(exclude_none=True) for tray in read_trays(base / given)]}
