"""The templates of this package, with the words that they use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .. import words
from . import rows


def page_template(name: str, folder: Path = Path(__file__).parent) -> Any:
    """A template of this package, or of another ``folder``, with the package's words in it."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, Path(__file__).parent]), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters.update(
        percent=words.percent, points=rows.percentage_points, number=rows.number, seconds=rows.seconds,
        cells="{} cells".format,
    )  # fmt: skip
    environment.globals.update(rows=rows, words=words, dash=words.NO_VALUE)
    return environment.get_template(name)
