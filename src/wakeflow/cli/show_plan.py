"""The plan on a screen: ten lines of what is flown, what is left out, what is doubtful and what it costs; or all."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

from ..core.store import cache_root
from ..planning.cost import begins, wall_seconds
from ..planning.plan import whole_terms
from ..runs.progress import on_this_machine
from ..show.plan_words import MAX_DOUBTS, UNITS, cost_words, doubts, plan_lines
from .screen import plain, screen_table, warn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table
    from rich.text import Text

    from ..planning.plan import Plan
    from ..planning.stages import StageCost
    from ..planning.terms import LeftOut
    from ..scene import Scene


BAR = 28  # letters of the bar chart of stages


def show_plan(plan: Plan, scene: Scene, units: Mapping[str, str] = UNITS) -> None:
    """Print in some ten lines what is flown, what is left out, what is doubtful and what it costs; ``units`` as in
    :func:`wakeflow.show.sketch.draw_sketch`.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    lines = Table.grid(padding=(0, 2))
    lines.add_column(style="bold", no_wrap=True)
    lines.add_column()
    cost = cost_words(plan, *on_this_machine(plan, cache_root()))
    for label, text in (*plan_lines(plan, scene, cost, units), ("", _more(plan))):
        lines.add_row(label, Text(text))
    Console().print(lines, highlight=False)


def _more(plan: Plan) -> str:
    """What the lines do not say."""
    more = len(plan.notices) - min(len(doubts(plan)), MAX_DOUBTS)
    noted = f", and {more} more note{'s' if more > 1 else ''}" if more else ""
    return f"--all tells every bound and stage{noted}"


def show_whole_plan(plan: Plan) -> None:
    """Print what is used, the bound on every term for every fraction, what is left out, every stage, every warning."""
    from rich.console import Console

    console = Console()
    for line in plan.used:
        console.print(f"• {line}", highlight=False, markup=False)
    if any(how.bounds for how in plan.fractions.values()):
        console.print(_bounds_table(plan))
    rows = []
    for (name, why), out in _grouped(plan.left_out).items():
        bounds = "\n".join(f"{row.bound:.2g}" if isfinite(row.bound) else "–" for row in out)
        rows.append([name, "\n".join(row.fraction or "all" for row in out), bounds, why])
    console.print(screen_table(["left out", "fraction", f"bound ({plan.unit})", "why"], rows, left=4))
    stages, runs = on_this_machine(plan, cache_root())
    console.print(_stages_table(stages))
    warn(plan.warnings, [notice.grade.value for notice in plan.notices], most=len(plan.notices))
    console.print(cost_words(plan, stages, runs), highlight=False)


def _stages_table(stages: Sequence[StageCost]) -> Table:
    """Every stage in order, what it is expected to take here, seconds and memory, and when: a bar chart."""
    second = BAR / max(wall_seconds(stages), 1e-9)
    rows = [
        [
            stage.name + (f" ({stage.times} times)" if stage.times > 1 else ""),
            " " * int(second * begun) + "=" * max(1, round(second * stage.whole)),
            f"{stage.whole:.0f}" if stage.whole >= 1.0 else "< 1",
            f"{stage.memory / 1e6:.0f}",
        ]
        for stage, begun in zip(stages, begins(stages), strict=True)
    ]
    title = f"what is done when, on two cores (= is {1 / second:.2g} s)"
    return screen_table(["stage", "when", "s", "MB"], rows, title, left=2)


def _grouped(rows: Sequence[LeftOut]) -> dict[tuple[str, str], list[LeftOut]]:
    """Rows with the same name and reason together, whatever their fraction."""
    groups: dict[tuple[str, str], list[LeftOut]] = {}
    for row in rows:
        groups.setdefault((row.name, row.why), []).append(row)
    return groups


def _bounds_table(plan: Plan) -> Table:
    """Terms by fractions: what each could move, in body widths; a star where it is computed."""
    terms = list(next(iter(plan.fractions.values())).bounds)
    whole = whole_terms(plan.airflow, plan.crowd)
    rows: list[Sequence[str | Text]] = []
    for term in terms:
        cells = [
            plain(f"* {how.bounds[term]:.2g}", "bold")
            if term in how.forces or term in whole
            else plain(f"{how.bounds[term]:.2g}")
            for how in plan.fractions.values()
        ]
        rows.append([term, *cells])
    rows += [[], ["left out below", *(f"{how.limit:.2g}" for how in plan.fractions.values())]]
    title = f"how far each term could move a fraction, {plan.unit} (accuracy {plan.target_error:.2g} of a share)"
    return screen_table(["term", *plan.fractions], rows, title, "* computed; the rest left out")
