"""[[measured]]: what was weighed or counted in the trays of a real machine, in a scene or as a CSV file.

A row is one tray: its ``bin``, the ``fraction`` that was sorted out of it (none: the tray was weighed as it is, all
fractions together), and the ``share`` of that fraction's mass in it, or the ``mass`` or the ``count`` of granules that
lay there. An uncertainty is half of a 95 % interval, as everywhere.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, isfinite
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from ..core.arrays import plain
from ..core.errors import SceneError
from ..core.files import path_of, user_path
from ..core.number import Number
from ..core.quantities import quantity, split_quantity
from ..core.registry import did_you_mean
from ..core.tables import read_sheet
from .table import RESERVED_BIN, SHARE, Name, Table
from .uncertainty import SIGMAS

Array = NDArray[np.float64]
AMOUNTS = ("share", "mass", "count")  # of which a row gives one
HEADS = ["fraction", "bin", *AMOUNTS, "uncertainty"]
BY_CHANCE = 0.5  # granules that are added to each counted tray where its chance is judged (Jeffreys' prior)
EXAMPLE = "fraction,bin,share,uncertainty"
# No scale reads wider than this, in any unit; squares of such numbers and of their ratios are still what floats hold.
LEAST_MASS, MOST = 1e-12, 1e12
LEAST_SHARE = 1e-6  # of the uncertainty of a share: nobody sorts a million kernels; what is less counts as exact
THOUSANDS = re.compile(r"[0-9]{1,3}(?:([.,])[0-9]{3})+")  # 1,000 or 1.000: parted here, a decimal mark there
NOTHING = ("None", "nan", "<NA>", "NaT")  # cells of a frame where nothing was measured


class Tray(Table):
    """One tray: what lay in it. Give ``share``, ``mass`` or ``count``."""

    bin: Name = Field(description="bin that the tray is, or elsewhere")
    fraction: Name | None = Field(None, description="fraction sorted out of it; without one the tray was not sorted")
    share: Annotated[float, Field(ge=0, le=1), SHARE] | None = Field(
        None, description="share of the fraction's mass, or of the whole feed's where the tray was not sorted"
    )
    mass: Annotated[float, Field(ge=0, le=MOST)] | None = Field(
        None, description="mass in any unit, the same for all trays, or with its unit"
    )
    count: Annotated[int, Field(ge=0, le=int(MOST))] | None = Field(
        None, description="granules, of every tray of the fraction"
    )
    uncertainty: Annotated[float, Field(ge=0), SHARE] = Field(
        0.0, description="half of the 95 % interval of the share or mass; of a count only what is beyond chance"
    )

    @model_validator(mode="before")
    @classmethod
    def _part_of_mass(cls, data: Any) -> Any:
        """An uncertainty in percent beside a mass is that part of the mass."""
        given, mass = (data.get(key) for key in ("uncertainty", "mass")) if isinstance(data, Mapping) else (None, None)
        if not isinstance(given, str) or not isinstance(mass, int | float) or not 0.0 <= mass <= MOST:
            return data
        try:
            return {**data, "uncertainty": mass * quantity(given, "1", "10 %")}
        except ValueError:
            return data  # which its own field refuses

    @model_validator(mode="after")
    def _one_amount(self) -> Tray:
        given = [name for name in AMOUNTS if getattr(self, name) is not None]
        if len(given) != 1:
            raise SceneError(f"{self.about}: give share, mass or count, one of them")
        if given == ["count"] and self.fraction is None:  # whose granules differ in mass
            raise SceneError(f"{self.about}: a count needs its fraction; give it, or weigh the tray: mass")
        if given != ["count"] and not self.uncertainty:
            raise SceneError(f"{self.about}: give its uncertainty, half of the 95 % interval, above 0")
        self._check_sizes()
        return self

    def _check_sizes(self) -> None:
        """Raise SceneError where the mass is no scale's, or the uncertainty none of such a number."""
        if self.mass and self.mass < LEAST_MASS:
            raise SceneError(f"{self.about}: mass = {self.mass:g}: give 0 or {LEAST_MASS:g} at least, in another unit")
        least, most = (LEAST_SHARE, 1.0) if self.mass is None else (LEAST_MASS, MOST)
        if self.uncertainty and not least <= self.uncertainty <= most:
            points = self.mass is None and 1.0 < self.uncertainty <= 100.0
            hint = f", or '{self.uncertainty:g} %'" if points else ""
            raise SceneError(f"{self.about}: uncertainty = {self.uncertainty:g}: write {least:g} to {most:g}{hint}")

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
    summed: tuple[str | None, ...] = ()  # fractions whose shares are of the sum of their trays

    @classmethod
    def of(cls, trays: Sequence[Tray]) -> Measured:
        """What ``trays`` say; those of one fraction and bin are added up, but for shares, which stay as many
        measurements.

        Raises SceneError where one fraction is given in two ways, or nothing was found of it.
        """
        trays = _added_up(trays)
        shares, covariance = np.zeros(len(trays)), np.zeros((len(trays), len(trays)))
        for name in dict.fromkeys(tray.fraction for tray in trays):
            mine = [place for place, tray in enumerate(trays) if tray.fraction == name]
            result, spread = _of_fraction([trays[place] for place in mine])
            shares[mine] = result
            covariance[np.ix_(mine, mine)] = spread
        summed = tuple({tray.fraction for tray in trays if tray.amount != "share"})
        return cls(tuple((tray.fraction, tray.bin) for tray in trays), shares, covariance, summed)

    def numbers(self) -> list[Number]:
        """Each share with its 95 % interval."""
        halves = SIGMAS * np.sqrt(np.diag(self.covariance))
        low, high = np.maximum(self.shares - halves, 0.0), np.minimum(self.shares + halves, 1.0)
        ends = zip(self.shares, low, high, strict=True)
        return [Number(*map(float, item)) for item in ends]

    def weights(self, known: Sequence[tuple[str, str]], mass: Mapping[str, float]) -> Array:
        """What each tray (n,) holds of the shares ``known`` (S,) by fraction and bin; ``mass``: share of every fraction
        in the feed, which trays that were not sorted are made of.

        Raises SceneError for a tray of a fraction or bin that there is not, and for a bin without a tray where shares
        are of the sum of all.
        """
        for name in self.summed:
            wanted = {bin_ for of, bin_ in known if name in (None, of)} - {RESERVED_BIN}
            if lacking := sorted(wanted - {place for fraction, place in self.places if fraction == name}):
                missing = f"no mass or count in {', '.join(lacking)}"
                raise SceneError(f"measured: {name or 'all fractions'}: {missing}; give 0 where nothing lay")
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


def _added_up(trays: Sequence[Tray]) -> list[Tray]:
    """The trays, each mass or count that is in several lines as one: each is divided by the sum of all."""
    result: dict[object, Tray] = {}
    for line, tray in enumerate(trays):
        kind = tray.amount
        place = line if kind == "share" else (tray.fraction, tray.bin, kind)
        if (item := result.get(place)) is not None:
            spread = hypot(item.uncertainty, tray.uncertainty)
            tray = item.model_copy(update={kind: getattr(item, kind) + getattr(tray, kind), "uncertainty": spread})
        result[place] = tray
    return list(result.values())


def _of_fraction(trays: Sequence[Tray]) -> tuple[Array, Array]:
    """Shares (n,) and covariance (n, n) of the trays of one fraction."""
    amounts = {tray.amount for tray in trays}
    if len(amounts) > 1:
        raise SceneError(f"measured: {trays[0].about}: give all trays of it as {' or as '.join(sorted(amounts))}")
    amount = amounts.pop()
    given = np.array([float(getattr(tray, amount)) for tray in trays])
    errors = np.array([tray.uncertainty / SIGMAS for tray in trays])
    if amount == "share":
        return given, np.diag(errors**2)
    total = float(given.sum())
    if total <= 0.0:
        raise SceneError(f"measured: {trays[0].about}: nothing lay in any tray of it")
    shares = given / total
    if amount == "mass":  # each share is of the sum of all trays, which the masses move together
        slope = (np.eye(len(given)) - shares[:, None]) / total
        return shares, slope @ np.diag(errors**2) @ slope.T
    chance = (given + BY_CHANCE) / (given + BY_CHANCE).sum()
    return shares, (np.diag(chance) - np.outer(chance, chance)) / total + np.diag(errors**2)


# -- The file ----------------------------------------------------------------------------------------------------------
def read_trays(path: Path | str) -> list[Tray]:
    """The trays of a CSV file, as :func:`~wakeflow.core.tables.read_sheet` reads it: a line a tray under the heads
    fraction, bin, uncertainty and share, mass or count, in any order; a last line that is their sum does not count.

    Raises SceneError, one line that names the line of the file, for what cannot be read.
    """
    file = path_of(path, "measured")
    try:
        sheet = read_sheet(file, whole="count")
    except SceneError as problem:
        raise SceneError(f"measured: {problem}") from None
    except OSError as problem:
        raise SceneError(f"measured: cannot read {file}: {problem.strerror}") from None
    if not sheet.heads:
        raise SceneError(f"measured: {file.name} is empty; its first line is {EXAMPLE}")
    _check_heads(sheet.heads, file.name)
    places = [[i for i, head in enumerate(sheet.heads) if head in names] for names in (("fraction", "bin"), AMOUNTS)]
    result = _trays(sheet.heads, sheet.added_up(*places).rows)
    if not result:
        raise SceneError(f"measured: {file.name} holds no tray; write one a line: wheat,middle,0.12,0.02")
    return result


def trays_of_columns(columns: Mapping[Any, Any]) -> list[Tray]:
    """The trays of columns by their heads, which are those of a file; numbers, or texts as in a file.

    Raises SceneError, one line that names the column or the row, for what cannot be read.
    """
    heads = [str(head) for head in columns]
    arrays = [np.asarray(plain(f"measured: column {head}", item), dtype=object) for head, item in columns.items()]
    _check_heads(heads, "columns")
    for head, item in zip(heads, arrays, strict=True):
        if item.ndim != 1:
            raise SceneError(f"measured: column {head} needs a list of cells, one a tray")
        if len(item) != len(arrays[0]):
            raise SceneError(f"measured: columns differ: {heads[0]} has {len(arrays[0])} cells, {head} has {len(item)}")
    rows = [(f"row {i}", [_text(cell) for cell in row]) for i, row in enumerate(zip(*arrays, strict=True), 1)]
    if not rows:
        raise SceneError("measured: columns hold no tray; give one a row")
    return _trays(heads, rows)


def _text(cell: object) -> str:
    if isinstance(cell, str):
        return cell  # a fraction may be called nan
    return "" if str(cell) in NOTHING else str(cell)


def _check_heads(heads: Sequence[str], name: str) -> None:
    unknown = [head for head in heads if head not in HEADS]
    if unknown:
        raise SceneError(
            f"measured: {name}: head {unknown[0]!r} is unknown{did_you_mean(unknown[0], HEADS)}; heads are "
            f"{EXAMPLE}, or mass or count for share"
        )
    if "bin" not in heads or not set(AMOUNTS) & set(heads):
        raise SceneError(f"measured: {name}: lacks bin, or share, mass or count; heads are {EXAMPLE}")
    if twice := next((head for head in heads if heads.count(head) > 1), None):
        raise SceneError(f"measured: {name}: head {twice!r} is there twice; delete one of the columns")


def _trays(heads: Sequence[str], rows: Sequence[tuple[str, Sequence[str]]]) -> list[Tray]:
    """The trays of rows, all masses in kg or all in a unit that is not said."""
    place = heads.index("mass") if "mass" in heads else len(heads)
    weighed = [split_quantity(cells[place]) for _, cells in rows if place < len(cells)]
    if len({bool(parts[1]) for parts in weighed if parts is not None}) > 1:
        raise SceneError("measured: some masses have a unit; write it behind each, or in the head: mass (g)")
    return [_tray(heads, cells, at) for at, cells in rows]


def _tray(heads: Sequence[str], cells: Sequence[str], at: str) -> Tray:
    """The tray of one line or row. Raises SceneError that names it."""
    if len(cells) != len(heads):
        raise SceneError(f"measured: {at}: has {len(cells)} cells, its heads are {len(heads)}")
    table: dict[str, Any] = {head: cell.strip() for head, cell in zip(heads, cells, strict=True) if cell.strip()}
    if not set(AMOUNTS) & set(table):
        raise SceneError(f"measured: {at}: is not filled in; give its share, mass or count, or delete the line")
    weighed = split_quantity(table.get("mass", ""))
    if weighed is not None and weighed[1] and (parts := split_quantity(table.get("uncertainty", ""))):
        table["uncertainty"] += "" if parts[1] else f" {weighed[1]}"
    for head in ("share", "mass", "count", "uncertainty"):
        if head in table:
            table[head] = _number(table[head], head, at)
    try:
        return Tray(**table)
    except ValidationError as problem:
        first = problem.errors()[0]
        what = "".join(f"{part} = {table.get(str(part))!r}: " for part in first["loc"])
        words = first["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
        raise SceneError(f"measured: {at}: {what}{words}") from None


def _number(text: str, head: str, at: str) -> float | int | str:
    """A cell as a number; a share or an uncertainty that is written in percent as it is, for the tray to read."""
    parts = split_quantity(text)
    if parts is not None and parts[1] == "%" and head in ("share", "uncertainty"):
        return text
    if parts is not None and parts[1] and head in ("mass", "uncertainty"):
        try:
            return quantity(text, "kg", "10.2 g")
        except ValueError as problem:
            raise SceneError(f"measured: {at}: {head} = {text!r} {problem}") from None
    if head == "count" and (grouped := THOUSANDS.fullmatch(text)):
        raise SceneError(f"measured: {at}: count = {text!r}: write {text.replace(grouped[1], '')}")
    try:
        value = float(text.replace("_", " "))  # 1_000 is one of Python's alone
    except ValueError:
        raise SceneError(f"measured: {at}: {head} = {text!r} is no number; write one such as 10.2") from None
    if not isfinite(value):
        raise SceneError(f"measured: {at}: {head} = {text!r}: needs a finite number")
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
    trays = read_trays(user_path(given, base, "measured"))
    return {**data, "measured": [tray.model_dump(exclude_unset=True) for tray in trays]}
