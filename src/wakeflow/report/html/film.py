"""The film of a run on its page: where `wakeflow animate` has made one, in a section of its own."""

from __future__ import annotations

import base64
import re
from pathlib import Path

from ...core.files import atomic_write
from ..film import FORMATS

__all__ = ["film_in", "film_section", "show_film"]

MOST = 5e6  # bytes of a film that the page holds, so that it stays below twice that
BEGIN, END = "<!-- film -->", "<!-- /film -->"
ALT = "Granules of the fractions on their way past the bodies, through the turning air"
CAPTION = (
    "Granules as they come, on their way past the bodies. Colour behind them: the air's vorticity, blue clockwise, red "
    "counter-clockwise."
)


def film_in(folder: Path) -> Path | None:
    """The film among the figures of a run, the newest of its formats; None without one."""
    found = [path for suffix in FORMATS if (path := folder / "figures" / f"film.{suffix}").exists()]
    return max(found, key=lambda path: path.stat().st_mtime, default=None)


def film_section(film: Path | None) -> str:
    """The section of the page between its marks, empty without a film; one that is too large is named, not shown."""
    if film is None:
        return f"{BEGIN}{END}"
    size = film.stat().st_size
    if size > MOST:
        shown = f"<p>figures/{film.name}, {size / 1e6:.3g} MB: too large for the page.</p>"
    else:
        data = base64.b64encode(film.read_bytes()).decode("ascii")
        shown = f"<figure>{_player(film.suffix, data)}<figcaption>{CAPTION}</figcaption></figure>"
    head = '<section id="film">\n<h2>Film</h2>\n<details open><summary>Close this to stop it</summary>\n'
    return f"{BEGIN}{head}{shown}\n</details>\n</section>{END}"


def _player(suffix: str, data: str) -> str:
    if suffix == ".mp4":
        return f'<video controls loop muted playsinline aria-label="{ALT}" src="data:video/mp4;base64,{data}"></video>'
    return f'<img alt="{ALT}" src="data:image/gif;base64,{data}">'


def show_film(folder: Path, film: Path) -> None:
    """Put a film on the page of a run that has one, in place of an earlier film; a page without room for it stays."""
    page = folder / "report.html"
    if not page.exists():
        return
    text = page.read_text(encoding="utf-8")
    section = film_section(film)
    with atomic_write(page) as stream:
        stream.write(re.sub(f"{BEGIN}.*?{END}", lambda _: section, text, count=1, flags=re.DOTALL))
