"""The plan on a screen: ten lines of what is flown, what is left out, what is doubtful and what it costs; or all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..air.kinds.every_kind import airflow_kinds
from ..core.graded import Grade, Notice
from ..core.process import cores
from ..core.quantities import duration, metres, say, speaking
from ..core.store import cache_root
from ..planning.cost import begins, typical_cells, wall_seconds
from ..planning.lifting import floor_notices, lifting_line
from ..planning.plan import REPLICATES, replicate_size, whole_terms
from ..planning.trade_lines import trade_lines
from ..runs.progress import on_this_machine
from ..show.machine_words import fall_words, motion_words, tilt_words
from .screen import MAX_WARNINGS, plain, screen_table, warn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table
    from rich.text import Text

    from ..planning.plan import Plan
    from ..planning.stages import StageCost
    from ..planning.terms import LeftOut
    from ..scene import Body, Scene


UNITS = {"m": "mm", "kg/s": "kg/h", "rad": "deg"}  # what is said where a scene does not write its own
BAR = 28  # letters of the bar chart of stages
WORTH_TELLING = 0.04  # of the whole run time: a part that takes less is not named
SIDE_BY_SIDE = 1.15  # parts that add up to so many times the whole run overlap


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
    for label, text in (*plan_lines(plan, scene, units), ("", _more(plan))):
        lines.add_row(label, Text(text))
    Console().print(lines, highlight=False)


def plan_lines(plan: Plan, scene: Scene, units: Mapping[str, str] = UNITS) -> list[tuple[str, str]]:
    """Label and text of each line of :func:`show_plan` but its last, which names an option."""
    with speaking({**UNITS, **units}):
        return list(_lines(plan, scene))


def _lines(plan: Plan, scene: Scene) -> Iterator[tuple[str, str]]:
    """Label and text of each line."""
    yield "machine", _machine(scene)
    yield "air", _air(plan, scene)
    if lifted := lifting_line(scene, plan.fractions):
        yield "lifting", lifted
    yield "feed", _feed(scene)
    yield from trade_lines(scene)
    if held := [f"{name} at most {100 * most:.4g} %" for name, most in scene.limit.asked.items()]:
        yield "held to", ", ".join(held)
    yield "flown with", _terms(plan)
    if plan.crowd is not None:
        flying = _round(sum(plan.crowd.in_flight.values()))
        yield "meetings", f"granules meet, {flying} at a time in a slab {metres(plan.crowd.depth, 2)} deep"
    yield "left out", _left_out(plan)
    for number, notice in enumerate(floor_notices(scene)):
        yield "" if number else "uncaught", notice.text
    for number, notice in enumerate(_doubts(plan)[:MAX_WARNINGS]):
        grade = f"{notice.grade.value}: " if notice.grade is Grade.VOID else ""
        yield "" if number else "doubtful", grade + notice.text
    yield "costs", _cost(plan)


def _doubts(plan: Plan) -> list[Notice]:
    return [notice for notice in plan.notices if notice.grade is not Grade.INFORMATION]


def _more(plan: Plan) -> str:
    """What the lines do not say."""
    more = len(plan.notices) - min(len(_doubts(plan)), MAX_WARNINGS)
    noted = f", and {more} more note{'s' if more > 1 else ''}" if more else ""
    return f"--all tells every bound and stage{noted}"


def _machine(scene: Scene) -> str:
    ends = {name: (body.outline()[:, 0].min(), body.outline()[:, 0].max()) for name, body in scene.body.items()}
    bodies = [f"{name} {metres(float(b - a), 3)} wide{_slope(scene.body[name])}" for name, (a, b) in ends.items()]
    if scene.vibration is not None:
        bodies.append(f"vibrating at {motion_words(scene.vibration)}")
    many = len(scene.body) > 2
    standing = ", ".join([f"{len(scene.body)} bodies", bodies[0], *bodies[len(scene.body) :]] if many else bodies)
    channel = scene.channel
    place = f"channel of {metres(channel.width)} x {metres(channel.top - channel.bottom)}"
    if tilted := tilt_words(scene):
        place += f", {tilted}"
    count = f"{len(scene.bin)} bin{'s' if len(scene.bin) > 1 else ''}"
    return f"{standing} in a {place}; {count}" if bodies else f"empty {place}; {count}"


def _slope(body: Body) -> str:
    return "" if body.slope_angle is None else f", {say(body.slope_angle, 'rad', 4)}"


def _round(number: float) -> str:
    """A count that is known to two digits: 1700."""
    return "less than one" if 0.0 < number < 0.5 else f"{float(f'{number:.2g}'):.0f}"


def _air(plan: Plan, scene: Scene) -> str:
    if scene.air is None:
        return "none: granules fly in a vacuum"
    stream = scene.air.blows
    cells = typical_cells(scene, plan.airflow)
    about = f", about {_round(cells)} cells" if cells else ""
    return f"{stream}; rung {plan.rung}: {airflow_kinds[plan.airflow.kind].means}{about}"


def _feed(scene: Scene) -> str:
    rate = say(scene.feed.mass_flow, "kg/s")
    if scene.feed.rate is None:
        rate = f"no rate given ({rate} where one is needed)"
    depth = scene.feed.depth
    rate += f", {3.6 * scene.feed.mass_flow / depth:.3g} t/h per metre of depth"
    shares = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in scene.mass_shares().items())
    falls = f", {fall_words(scene.feed)}" if scene.body else ""
    count = REPLICATES * replicate_size(scene.feed.count)
    return f"{rate}{falls}: {shares}; {count} granules of each fly"


def _terms(plan: Plan) -> str:
    """The terms that all fractions fly with, and those that only some do."""
    terms = dict.fromkeys(term for fraction in plan.fractions.values() for term in fraction.forces)
    flown: dict[tuple[str, ...], list[str]] = {}
    for term in terms:
        names = tuple(name for name, fraction in plan.fractions.items() if term in fraction.forces)
        flown.setdefault(names, []).append(term)
    every = tuple(plan.fractions)
    common = ", ".join(flown.pop(every, []))
    return "; ".join([common, *(f"{', '.join(some)} for {' and '.join(names)}" for names, some in flown.items())])


def _left_out(plan: Plan) -> str:
    """Each term with the most that it could move a landing by; those that could move it too far are doubts."""
    most: dict[str, float] = {}
    for row in plan.left_out:
        most[row.name] = max(most.get(row.name, 0.0), row.bound or 0.0)
    doubted = {notice.text.partition(", left out")[0] for notice in plan.notices}
    told = [f"{name} {bound:.1g}" if bound else name for name, bound in most.items() if name not in doubted]
    return f"{', '.join(told)} ({plan.unit} at most)" if told else "nothing else"


def _cost(plan: Plan) -> str:
    """The run time on this machine by its parts, memory and disk."""
    stages, runs = on_this_machine(plan, cache_root())
    spent = _parts(stages)
    whole = wall_seconds(stages, cores())
    told = [f"{part} {duration(time)}" for part, time in spent.items() if time >= WORTH_TELLING * sum(spent.values())]
    if sum(spent.values()) > SIDE_BY_SIDE * whole:
        told.append("partly side by side")
    lately = "run" if runs == 1 else f"{runs} runs"
    learned = f"at the pace of the last {lately} here" if runs else "not measured on this machine yet"
    memory = max(plan.estimate.memory, *(stage.memory for stage in stages))
    return (
        f"about {duration(whole)}, {learned} ({', '.join(told)}); "
        f"{memory / 1e9:.1f} GB of memory, {plan.estimate.disk / 1e6:.0f} MB of disk"
    )


def _parts(stages: Sequence[StageCost]) -> dict[str, float]:
    """Seconds under each heading, the longest first."""
    spent: dict[str, float] = {}
    for stage in stages:
        spent[stage.key.heading] = spent.get(stage.key.heading, 0.0) + stage.whole
    return dict(sorted(spent.items(), key=lambda item: -item[1]))


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
        bounds = "\n".join("–" if row.bound is None else f"{row.bound:.2g}" for row in out)
        rows.append([name, "\n".join(row.fraction or "all" for row in out), bounds, why])
    console.print(screen_table(["left out", "fraction", f"bound ({plan.unit})", "why"], rows, left=4))
    console.print(_stages_table(on_this_machine(plan, cache_root())[0]))
    warn(plan.warnings, [notice.grade.value for notice in plan.notices], most=len(plan.notices))
    console.print(_cost(plan), highlight=False)


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
