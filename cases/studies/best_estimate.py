"""The data of the best estimate, and what each entry's body is told by the other entries alone.

.venv/bin/python cases/studies/best_estimate.py

For each entry of src/wakeflow/laws/wakes.toml: theta or strength by it with its own error, and with the range that the
program would take for that body if this entry did not exist; held: the two ranges meet.
"""

from __future__ import annotations

from wakeflow.core.number import Number
from wakeflow.laws.best_estimate import left_one_out

HEAD = (
    "entry", "shape", "blockage", "quantity", "at that blockage", "ends", "gives", "by the others", "held",
    "status, checked",
)  # fmt: skip


def told(number: Number) -> str:
    """The number with its range."""
    return f"{number.value:.2f} ({number.low:.2f} to {number.high:.2f})"


def main() -> None:
    """Print the table of docs/model.md."""
    print(f"| {' | '.join(HEAD)} |")
    print("|---" * len(HEAD) + "|")
    for entry, own, others in left_one_out():
        low, high = entry.here
        held = "yes" if own.low <= others.high and own.high >= others.low else "NO"
        row = (
            entry.name, entry.family, f"{entry.blockage:g}", entry.quantity, f"{low:.2f} to {high:.2f}",
            f"{entry.steady:g}, {entry.resolved:g}", told(own), told(others), held, f"{entry.status}, {entry.checked}",
        )  # fmt: skip
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
