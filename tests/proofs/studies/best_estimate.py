"""The data of the best estimate, and what the other entries alone say of each entry's body.

For each entry of src/wakeflow/laws/wakes.toml: theta or strength by it with its own error, and with the range that the
program would take for that body if this entry did not exist; held: the two ranges meet. The table of docs/model.md.
"""

from __future__ import annotations

from wakeflow.laws.best_estimate import left_one_out

from .common import Row, show

NUMBER = "{{{0}.value:.2f}} ({{{0}.low:.2f}} to {{{0}.high:.2f}})"
COLUMNS = {
    "entry": "{entry.name}", "shape": "{entry.family}", "blockage": "{entry.blockage:g}",
    "quantity": "{entry.quantity}", "at that blockage": "{entry.here[0]:.2f} to {entry.here[1]:.2f}",
    "ends": "{entry.steady:g}, {entry.resolved:g}", "gives": NUMBER.format("own"),
    "by the others": NUMBER.format("others"), "held": "{held:yes|NO}",
    "status, checked": "{entry.status}, {entry.checked}",
}  # fmt: skip


def main() -> list[Row]:
    """The best estimate's data, one entry left out at a time."""
    return show(COLUMNS, [
        {"entry": entry, "own": own, "others": others, "held": own.low <= others.high and own.high >= others.low}
        for entry, own, others in left_one_out()
    ])  # fmt: skip
