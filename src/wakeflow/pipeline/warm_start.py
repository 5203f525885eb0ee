"""Which solved airflow a new one starts from."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import write_json
from ..core.store import Store

if TYPE_CHECKING:
    from ..foam import FlowSpec

__all__ = ["nearest", "remember"]

NEAR = 2.0  # largest ratio of Reynolds numbers over which a solved airflow is a better start than the draft
CARD = "start.json"  # beside a solved airflow: what :func:`nearest` goes by


def remember(folder: Path, mesh_key: str, spec: FlowSpec) -> None:
    """Leave beside a solved airflow what tells others whether to start from it."""
    write_json(folder / CARD, {"mesh": mesh_key, "stepping": spec.stepping, "reynolds": spec.reynolds})


def nearest(store: Store, mesh_key: str, spec: FlowSpec) -> Path | None:
    """The case folder of the time-resolved airflow on the same mesh that is nearest in Reynolds number, within a factor
    of two; None without one.
    """
    near = []
    for folder, card in _cards(store):
        if (card["mesh"], card["stepping"]) == (mesh_key, "time-resolved"):
            near.append((abs(math.log(card["reynolds"] / spec.reynolds)), folder))
    for distance, folder in sorted(near):
        if distance <= math.log(NEAR) and store.holds("airflow", folder.name):
            return folder / "case"
    return None


def _cards(store: Store) -> Iterator[tuple[Path, dict[str, Any]]]:
    for path in sorted((store.root / "airflow").glob(f"*/{CARD}")):
        if path.parent.suffix != ".part":
            yield path.parent, json.loads(path.read_text())
