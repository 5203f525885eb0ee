"""Tables of cells: rows under their heads, as CSV and as what Python is handed; arrays in one file; and sheets, tables
of numbers as an office writes them: CSV of any separator, mark and coding, units in heads or cells.
"""

from __future__ import annotations

import codecs
import csv
import re
import struct
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .files import MAX_RECORD, atomic_write, read_whole
from .quantities import split_quantity

FORMULA = ("=", "+", "-", "@", "\t", "\r")  # with which a cell begins that spreadsheets take for a formula
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
Cell = str | float | bool | None
AnyArray = NDArray[Any]  # of numbers of any kind
Columns = dict[str, AnyArray]  # arrays of one length by their names


@dataclass(frozen=True)
class CellTable:
    """``rows`` of cells under ``heads``, which carry the units; None where nothing is known."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    @classmethod
    def of(cls, records: Iterable[object], attributes: Mapping[str, str]) -> CellTable:
        """A row a record; ``attributes``: the name of each by the head of its column."""
        return cls(tuple(attributes), [[getattr(item, name) for name in attributes.values()] for item in records])

    def write_csv(self, path: Path, digits: int = 10) -> None:
        """Write the table; empty where nothing is known, ``digits`` a number."""
        with atomic_write(path) as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(map(_shown, self.heads))
            writer.writerows([_shown(cell, digits) for cell in row] for row in self.rows)

    def columns(self) -> Columns:
        """Arrays by their heads: of float with nan where nothing is known, or of text."""
        return {head: _array([row[place] for row in self.rows]) for place, head in enumerate(self.heads)}

    def frame(self) -> Any:
        """The columns as of :func:`frame_of`."""
        return frame_of(self.columns())


def frame_of(columns: Mapping[str, AnyArray]) -> Any:
    """Arrays of one length by the heads of their columns, as a pandas DataFrame where pandas is installed, else as a
    dict.
    """
    if find_spec("pandas") is None:
        return dict(columns)
    return import_module("pandas").DataFrame(dict(columns))


def save_arrays(path: Path | str, arrays: Mapping[str, ArrayLike], *, compressed: bool = False) -> None:
    """Write arrays by their names as one file (.npz), whole or not at all."""
    with atomic_write(path, "wb") as stream:
        write_arrays(stream, arrays, compressed=compressed)


def write_arrays(stream: IO[bytes], arrays: Mapping[str, ArrayLike], *, compressed: bool = False) -> None:
    """The bytes of ``numpy.savez``, which up to numpy 2.0 leaves its archive open where the disk is full: Python then
    closes it some time later, and prints a traceback of that.
    """
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(values), allow_pickle=False)


def load_arrays(path: Path, cure: str) -> Columns:
    """What :func:`save_arrays` wrote, or numpy's compressed form of it; code in a file is never run.

    Raises SceneError, with the ``cure``, where the file is damaged or, before anything is unpacked, where it claims to
    hold more than it may.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            inside = archive.infolist()
        packed = any(item.compress_type != zipfile.ZIP_STORED for item in inside)
        if sum(item.file_size for item in inside) > (MAX_RECORD if packed else path.stat().st_size):
            raise SceneError(f"{path} claims to hold more than it may; {cure}")
        with np.load(path, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}
    except (FileNotFoundError, IsADirectoryError, PermissionError):
        raise
    except SceneError:
        raise
    except DAMAGES:
        raise SceneError(f"{path} is damaged; {cure}") from None


# what zipfile and numpy say of archives that are none, cut short, encrypted, of unknown kinds or with other heads
DAMAGES = (
    OSError, ValueError, EOFError, LookupError, NotImplementedError, RuntimeError, MemoryError, OverflowError,
    SyntaxError, TypeError, AttributeError, zipfile.BadZipFile, zlib.error, struct.error,
)  # fmt: skip


def _array(cells: Sequence[Cell]) -> AnyArray:
    if any(isinstance(cell, str) for cell in cells):
        return np.array([_text(cell) for cell in cells], dtype=object)
    return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)


def _shown(cell: Cell, digits: int = 10) -> str:
    """A cell of a CSV file: text that a spreadsheet would take for a formula begins with an apostrophe there."""
    text = _text(cell, digits)
    return f"'{text}" if isinstance(cell, str) and text.startswith(FORMULA) and not NUMBER.fullmatch(text) else text


def _text(cell: Cell, digits: int = 10) -> str:
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return "" if cell is None else f"{cell:.{digits}g}" if isinstance(cell, float) else str(cell)


# -- Tables of numbers as an office writes them ------------------------------------------------------------------------
MARKS = (";", "\t", ",")  # that part cells, the first that is in the heads
PARTED = re.compile(r"[-+]?[1-9][0-9]{0,2}([.,])[0-9]{3}(?:\1[0-9]{3})*")  # a decimal mark, or one of thousands
DECIMAL = re.compile(r"([-+]?[0-9]*)([.,])([0-9]+(?:[eE][-+]?[0-9]+)?)")
GROUPED = re.compile(r"[-+]?[1-9][0-9]{0,2}(?:[ .,'’_\u00a0\u202f][0-9]{3})+(?:[.,][0-9]+)?")
QUANTITY = re.compile(r"([-+]?[0-9.,](?:[0-9.,'’_ \u00a0\u202f]*[0-9.,])?(?:[eE][-+]?[0-9]+)?)\s*([^0-9].*)?")
HEAD = re.compile(r"(.*?)\s*[(\[]\s*([^()\[\]]+?)\s*[)\]]")  # a name and its unit: mass (g)
SUMS = {
    "sum", "sums", "total", "totals", "summe", "gesamt", "insgesamt", "gesamtsumme", "somme", "suma", "razem", "итого",
    "всего", "сумма", "Σ", "∑",
}  # fmt: skip


@dataclass(frozen=True)
class Sheet:
    """The rows of a file: where each is, in words, and its cells without blanks around them; numbers with a decimal
    point, and their unit behind them, from the cell or from the head of the column.
    """

    heads: Sequence[str]
    rows: Sequence[tuple[str, list[str]]]

    def added_up(self, labels: Sequence[int], amounts: Sequence[int]) -> Sheet:
        """The sheet without a last row that is the sum of those before it in the columns ``amounts``, and is called so
        in one of the columns ``labels``. Raises SceneError where it adds up to another number.
        """
        if len(self.rows) < 2 or not {self.rows[-1][1][item].rstrip(":").lower() for item in labels} & SUMS:
            return self
        *rows, (at, last) = self.rows
        for column in amounts:
            parts = [split_quantity(cells[column]) for _, cells in rows]
            if (said := split_quantity(last[column])) is not None:
                result = sum(part[0] for part in parts if part is not None)
                if abs(result - said[0]) > 0.005 * abs(result):
                    raise SceneError(f"{at}: {said[0]:g} is not the sum of the rows before it, {result:g}; delete it")
        return Sheet(self.heads, rows)


def read_sheet(path: Path, *, headed: bool = True, whole: str = "") -> Sheet:
    """The table in a CSV file, its heads in small letters; without heads where it is not ``headed``, when lines before
    the first of numbers are passed over; the head ``whole`` is that of counts. Empty rows and closing separators do not
    count, lines that begin with # are notes, ``sep=;`` in the first line names the separator.

    Raises SceneError, with the line, for what has two meanings: 1.234 where no other number says which mark parts
    decimals. Raises OSError for a file that cannot be read.
    """
    lines = [
        (number, line) for number, line in enumerate(_decoded(path).splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]  # fmt: skip
    mark = ""
    if lines and (named := re.fullmatch(r"\s*\"?sep=(.|\\t)\"?\s*", lines[0][1], re.IGNORECASE)):
        mark = named[1].replace("\\t", "\t")
        del lines[0]
    table = [(f"{path.name}, line {number}", cells) for number, cells in _cells(path.name, lines, mark, headed)]
    table = [(at, cells) for at, cells in table if any(cells)]
    if not table:
        return Sheet((), ())
    heads: list[str] = []
    while table and (not heads if headed else not QUANTITY.fullmatch(table[0][1][0])):
        heads = _without_end(table.pop(0)[1])
    width = len(heads) if headed else 0
    points = {mark for _, row in table for cell in row if (mark := _decimal_mark(cell))}
    units = {i: match[2] for i, head in enumerate(heads) if (match := HEAD.fullmatch(head))}
    names = [match[1].lower() if (match := HEAD.fullmatch(head)) else head.lower() for head in heads]
    rows = []
    for at, cells in table:
        kept = _without_end(cells, width)
        said = [f"{at}: {names[i]} =" if i < width else f"{at}:" for i in range(len(kept))]
        rows.append((at, [_plain(cell, units.get(i, ""), points, said[i], whole) for i, cell in enumerate(kept)]))
    return Sheet(names, rows)


def _decoded(path: Path) -> str:
    raw = read_whole(path)
    wide = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return raw.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        text = raw.decode("cp1252")
    except UnicodeDecodeError:
        text = "\0"
    if any(ord(item) < 32 and item not in "\t\r\n\f" for item in text):
        raise SceneError(f"cannot read {path}: not a text file")
    return text


def _cells(name: str, lines: Sequence[tuple[int, str]], mark: str, headed: bool) -> list[tuple[int, list[str]]]:
    result = []
    for number, line in lines:
        in_line = next((item for item in MARKS if item in line), "")
        parting = mark or in_line
        mark = parting if headed else mark  # a table without heads tells it line by line
        try:
            cells = next(csv.reader([line], delimiter=parting)) if parting else line.split() if not headed else [line]
        except csv.Error as problem:
            raise SceneError(f"{name}, line {number}: {problem}; part cells by commas or semicolons") from None
        result.append((number, [cell.strip().strip("\u00a0") for cell in cells]))
    return result


def _without_end(cells: list[str], least: int = 0) -> list[str]:
    """The cells up to the last that holds anything, ``least`` at least."""
    while len(cells) > least and not cells[-1]:
        cells = cells[:-1]
    return cells


def _decimal_mark(cell: str) -> str:
    """The mark in the number of a cell that can only be a decimal one; empty for any other."""
    number = QUANTITY.fullmatch(cell)
    parted = number and DECIMAL.fullmatch(number[1])
    return "" if parted is None or PARTED.fullmatch(parted[0]) else parted[2]


def _plain(cell: str, unit: str, points: set[str], at: str, whole: str) -> str:
    """A cell with its number as a program reads it, and its unit."""
    quantity = QUANTITY.fullmatch(cell)
    if quantity is None:
        return cell
    number, unit = quantity[1], quantity[2] or unit
    parted = PARTED.fullmatch(number)
    counts = at.endswith(f": {whole} =")
    if GROUPED.fullmatch(number) and not (parted and points == {parted[1]} and not counts):
        plain = re.sub(r"[ .,'’_\u00a0\u202f](?=[0-9]{3}(?![0-9]))", "", number)
        once = parted and not counts and len(re.findall(r"[.,]", number)) == 1
        other = f" or {number.replace(',', '.')}0" if once else ""
        raise SceneError(f"{at} {number!r} may have thousands parted; write {plain.replace(',', '.')}{other}")
    return f"{number.replace(',', '.')} {unit}".strip() if re.fullmatch(r"[^,]*,[^,]*", number) or unit else cell
