"""By how much a scene's tolerance moves shares: many granules of the shipped rhombus, at the tolerance that scenes ask
for and at a far smaller one, through the same noise, with the forces of the answer in its own air.

So many fly that chance, the standard error of the granules' own differences, is below a tenth of a point.
"""

from __future__ import annotations

from collections.abc import Iterator

from proofs.tracker.flights import WANTED, FlownKind, exchanged, flown_kinds
from support import shipped

from .common import BARE, Row, compile_tracker, piped, show

COLUMNS = {
    "granule": "{kind}", "granules": "{count}", "in another bin, %": "{moved:.3f*100}",
    "largest change, points": "{change:+.3f*100} ± {sampling:.3f*100}",
}  # fmt: skip


def row(one: FlownKind, reference: float) -> Row:
    """What granules of one kind land apart at the two tolerances."""
    ends = one.fly(WANTED), one.fly(reference)
    return {"kind": one.kind, "count": len(one.grains), **exchanged(*ends, len(one.flight.scene.bin))}


def main(rung: str = "standard", *kinds: str, count: int = 131072, reference: float = 1e-6) -> list[Row]:
    """Shares at a tolerance of 1e-2 less those at ``reference``, of ``count`` granules of each of the ``kinds`` (none
    named: of all of ``FLOWN``).
    """
    scene = shipped("rhombus", {} if count > 1024 else {"numerics.mesh_scale": 3.0})
    compile_tracker()
    air = {rung: piped(scene, rung, BARE).field[1]}

    def rows() -> Iterator[Row]:
        for one in flown_kinds(scene, air, count):
            if not kinds or one.kind in kinds:
                yield row(one, reference)

    return show(COLUMNS, rows())
