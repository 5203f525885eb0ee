"""The command that makes room: clean; and how stages of the cache are listed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Annotated

from cyclopts import Parameter

from ..core.quantities import duration
from ..core.store import KeptStage, bytes_of, cache_root, kept_stages, oldest_beyond, remove_stages
from .screen import screen_table

NONE = "–"
MAX_ROWS = 50  # of the cache


def clean(
    *,
    everything: bool = False,
    keep: Annotated[str | None, Parameter(help="Remove what was used longest ago until this is left: 10GB.")] = None,
    dry_run: bool = False,
    yes: Annotated[bool, Parameter(negative="", help="Do not ask; without a terminal nothing is asked.")] = False,
) -> None:
    """Remove unfinished stages from the cache, and say what the others take on disk and would take to make again.

    Nothing else is ever removed: what has not the cache's mark, no folder of a stage, and what a link leads to stays;
    finished stages stay while a run reads them. What goes is listed before, and on a terminal you are asked.

    Parameters
    ----------
    everything
        Remove finished stages as well.
    dry_run
        Remove nothing; only say what is there, and what would be removed.
    """

    most, root = None if keep is None else bytes_of(keep), cache_root()
    stages = kept_stages(root)
    finished = [one for one in stages if one.finished]
    old = finished if everything else [] if most is None else oldest_beyond(finished, most)
    gone = [one for one in stages if not one.finished] + old
    print(f"cache: {root}")
    if gone:
        show_stages(gone, "to be removed")
        if dry_run or not (yes or _agreed()):
            show_removed(gone, done=False)
            gone = []
        else:
            gone = remove_stages(root, gone)
            show_removed(gone, done=True)
    show_stages([one for one in finished if one not in gone])


def _agreed() -> bool:
    """What the user answers on a terminal; without one nobody is there to be asked."""
    return not sys.stdin.isatty() or input("Remove them? [y/N] ").strip().lower() in ("y", "yes")


def show_removed(stages: Sequence[KeptStage], *, done: bool) -> None:
    """Say in one line what was or would be removed from the cache, and what making it again would take."""
    size, spent = sum(one.size for one in stages) / 1e6, sum(one.seconds or 0.0 for one in stages)
    verb, frees = ("removed", "freed") if done else ("would be removed", "would be freed")
    print(f"{len(stages)} stages {verb}, {size:.1f} MB {frees}, {duration(spent)} to make again")


def show_stages(stages: Sequence[KeptStage], title: str = "in the cache") -> None:
    """Print stages of the cache, the one that was used longest ago first: size, time to make it again."""
    from rich.console import Console

    def sums(used: str, what: str, part: Sequence[KeptStage]) -> list[str]:
        size, spent = sum(one.size for one in part), sum(one.seconds or 0.0 for one in part)
        return [used, f"{len(part)} {what}", "", f"{size / 1e6:.1f}", duration(spent)]

    rows: list[list[str]] = []
    for one in stages[:MAX_ROWS]:
        used = datetime.fromtimestamp(one.used, UTC).astimezone().strftime("%Y-%m-%d %H:%M")
        again = NONE if one.seconds is None else duration(one.seconds)
        key = one.folder.name[:12] + ("" if one.finished else " unfinished")
        rows.append([used, one.stage, key, f"{one.size / 1e6:.1f}", again])
    if len(stages) > MAX_ROWS:
        rows.append(sums("later", "more", stages[MAX_ROWS:]))
    heads = ("used", "stage", "key", "MB", "to make again")
    Console().print(screen_table(heads, [*rows, [], sums("all", "stages", stages)], title, left=3))


COMMANDS = (clean,)
