"""Tables of cells: rows under their heads, as CSV and as what Python is handed; and arrays in one file."""

from __future__ import annotations

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
from .files import MAX_RECORD, atomic_write

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
