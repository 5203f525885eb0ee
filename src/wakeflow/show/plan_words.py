"""A machine and its plan in words: the measures of the sketch, where the curtain falls, the lines of a plan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..air.kinds.every_kind import airflow_kinds
from ..core.graded import Grade, Notice
from ..core.process import cores
from ..core.quantities import duration, metres, say, speaking
from ..planning.cost import begins, typical_cells, wall_seconds
from ..planning.plan import REPLICATES, replicate_size, whole_terms
from ..planning.scene_lines import floor_notices, lifting_line, trade_lines
from .words import WordTable

if TYPE_CHECKING:
    from ..planning.plan import Plan
    from ..planning.stages import StageCost
    from ..planning.terms import LeftOut
    from ..scene import Body, Feed, Scene, Vibration

UNITS = {"m": "mm", "rad": "deg", "kg/s": "kg/h"}  # what measures are said in, where the user's units are not known
MAX_DOUBTS = 3  # that are named; --all tells the others
WORTH_TELLING = 0.04  # of the whole run time: a part that takes less is not named
BAR = 28  # letters of the bar chart of stages
SIDE_BY_SIDE = 1.15  # parts that add up to so many times the whole run overlap


def feed_words(scene: Scene) -> str:
    """The curtain in two lines: its width and fall, its mass flow."""
    feed = scene.feed
    lines = [f"feed: {metres(feed.width)} wide, {fall_words(feed)}"]
    if feed.position:
        lines[0] += f", x = {metres(feed.position)}"
    if feed.rate:
        lines.append(f"{say(feed.rate, 'kg/s')} over a depth of {metres(feed.depth)}")
    if scene.funnel is not None:
        lines.append(f"from a funnel with an outlet of {metres(scene.funnel.orifice)}")
    return "\n".join(lines)


def feed_corners(scene: Scene) -> NDArray[np.float64]:
    """Corners (4, 2) m of the falling curtain: its left and right end where it begins, then right and left at the
    body, or where it enters a channel without one.
    """
    (height, _), half = scene.release, scene.feed.width / 2
    x = scene.feed.position + half * np.array([-1.0, 1.0, 1.0, -1.0])
    y = np.array([scene.level + height, scene.level + height, scene.level, scene.level])
    return scene.plumb.placed(np.stack([x, y], axis=1))


def tilt_words(scene: Scene) -> str:
    """Where gravity points in a channel that does not stand upright; empty where it does."""
    tilt = scene.channel.tilt
    side = "right" if tilt > 0.0 else "left"
    return "" if scene.plumb.upright else f"gravity {say(abs(tilt), 'rad', 3)} from its axis, to the {side}"


def fall_words(feed: Feed) -> str:
    """How the curtain comes down."""
    if feed.start == "resting":
        return "at rest on the body"
    return f"comes at {say(feed.speed, 'm/s')}" if feed.speed is not None else f"falls {metres(feed.height)}"


def motion_words(vibration: Vibration) -> str:
    """Frequency, reach to either side, and peak acceleration of the bodies."""
    reach = metres(float(np.hypot(*vibration.displacement)), 3)
    if vibration.pivot is not None:
        x, y = (metres(part) for part in vibration.pivot)
        reach = f"{say(vibration.given['angle'], 'rad', 3)} about x = {x}, y = {y}"
    return f"{say(1.0 / vibration.period, 'Hz', 4)}, ± {reach} ({vibration.strength:.3g} g)"


def body_words(name: str, body: Body, whole: Scene | None) -> str:
    """A body's measures, its place unless that is the origin, and of the first one the motion of all."""
    size, given = np.ptp(body.outline(), axis=0), body.given
    if "thickness" in given:
        measures = f"{metres(given['length'])} x {metres(given['thickness'])}"
    elif body.shape == "circle":
        measures = f"{metres(float(size[0]))} across"
    else:
        measures = f"{metres(float(size[0]), 4)} x {metres(float(size[1]), 4)}"
    angle = f", {say(given['slope_angle'], 'rad', 4)}" if "slope_angle" in given else ""
    lines = [f"{name}: {measures}{angle}"]
    if any(body.at):
        lines.append(f"at x = {metres(body.at[0])}, y = {metres(body.at[1])}")
    if whole is not None and whole.vibration is not None:
        lines.append(f"{'vibrates' if len(whole.body) == 1 else 'all vibrate'} at {motion_words(whole.vibration)}")
    return "\n".join(lines)


# -- a plan ------------------------------------------------------------------------------------------------------------
def plan_lines(plan: Plan, scene: Scene, cost: str, units: Mapping[str, str] = UNITS) -> list[tuple[str, str]]:
    """Label and text of each of some ten lines: what is flown, left out and doubtful, and what it costs, ``cost`` as of
    :func:`cost_words`; ``units`` as in :func:`.sketch.draw_sketch`.
    """
    with speaking({**UNITS, **units}):
        return [*_lines(plan, scene), ("costs", cost)]


def told_by_all(plan: Plan) -> str:
    """What the lines of a plan do not say, and --all does."""
    more = len(plan.notices) - min(len(doubts(plan)), MAX_DOUBTS)
    noted = f", and {more} more note{'s' if more > 1 else ''}" if more else ""
    return f"--all tells every bound and stage{noted}"


def _lines(plan: Plan, scene: Scene) -> Iterator[tuple[str, str]]:
    yield "machine", _machine(scene)
    yield "air", _air(plan, scene)
    if lifted := lifting_line(scene, plan.fractions):
        yield "lifting", lifted
    yield "feed", _feed(scene)
    yield from trade_lines(scene)
    if held := [f"{name} at most {100 * most:.4g} %" for name, most in scene.limit.by_name.items()]:
        yield "held to", ", ".join(held)
    yield "flown with", _terms(plan)
    if plan.collisions is not None:
        flying = _round(sum(plan.collisions.in_flight.values()))
        yield "meetings", f"granules meet, {flying} at a time in a slab {metres(plan.collisions.depth, 2)} deep"
    yield "left out", _left_out(plan)
    for number, notice in enumerate(floor_notices(scene)):
        yield "" if number else "uncaught", notice.text
    for number, notice in enumerate(doubts(plan)[:MAX_DOUBTS]):
        grade = f"{notice.grade.value}: " if notice.grade is Grade.VOID else ""
        yield "" if number else "doubtful", grade + notice.text


def whole_plan(plan: Plan, stages: Sequence[StageCost]) -> Iterator[str | WordTable]:
    """What is used, the bound on every term for every fraction, what is left out, every stage."""
    yield from (f"• {line}" for line in plan.used)
    if any(how.bounds for how in plan.fractions.values()):
        yield _bounds(plan)
    yield WordTable(["left out", "fraction", f"bound ({plan.unit})", "why"], _left_out_rows(plan), left=4)
    yield _stages(stages)


def _bounds(plan: Plan) -> WordTable:
    """Terms by fractions: what each could move, in body widths; bold with a star where it is computed."""
    from rich.text import Text

    whole, rows = whole_terms(plan.airflow, plan.collisions), list[list[str | Text]]()
    for term in next(iter(plan.fractions.values())).bounds:
        cells = [
            Text(f"* {how.bounds[term]:.2g}", "bold")
            if term in how.forces or term in whole
            else Text(f"{how.bounds[term]:.2g}")
            for how in plan.fractions.values()
        ]
        rows.append([term, *cells])
    rows += [[], ["left out below", *(f"{how.limit:.2g}" for how in plan.fractions.values())]]
    title = f"how far each term could move a fraction, {plan.unit} (accuracy {plan.target_error:.2g} of a share)"
    return WordTable(["term", *plan.fractions], rows, title, "* computed; the rest left out")


def _left_out_rows(plan: Plan) -> list[list[str]]:
    """Name, fractions, bounds and reason of what is left out: those of one name and reason together."""
    groups: dict[tuple[str, str], list[LeftOut]] = {}
    for row in plan.left_out:
        groups.setdefault((row.name, row.why), []).append(row)
    return [
        [
            name, "\n".join(row.fraction or "all" for row in out),
            "\n".join(f"{row.bound:.2g}" if isfinite(row.bound) else "–" for row in out), why,
        ]
        for (name, why), out in groups.items()
    ]  # fmt: skip


def _stages(stages: Sequence[StageCost]) -> WordTable:
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
    return WordTable(["stage", "when", "s", "MB"], rows, title, left=2)


def doubts(plan: Plan) -> list[Notice]:
    """The notices that take something away from the answer."""
    return [notice for notice in plan.notices if notice.grade is not Grade.INFORMATION]


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
    return f", {say(body.given['slope_angle'], 'rad', 4)}" if "slope_angle" in body.given else ""


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
    if not scene.feed.rate:
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
        most[row.name] = max(most.get(row.name, 0.0), row.bound if isfinite(row.bound) else 0.0)
    doubted = {notice.text.partition(", left out")[0] for notice in plan.notices}
    terms = [f"{name} {bound:.1g}" if bound else name for name, bound in most.items() if name not in doubted]
    return f"{', '.join(terms)} ({plan.unit} at most)" if terms else "nothing else"


def cost_words(plan: Plan, stages: Sequence[StageCost], runs: int) -> str:
    """The run time by its parts, memory and disk: of ``stages`` as this machine's last ``runs`` say."""
    spent = _parts(stages)
    whole = wall_seconds(stages, cores())
    parts = [f"{part} {duration(time)}" for part, time in spent.items() if time >= WORTH_TELLING * sum(spent.values())]
    if sum(spent.values()) > SIDE_BY_SIDE * whole:
        parts.append("partly side by side")
    lately = "run" if runs == 1 else f"{runs} runs"
    learned = f"at the pace of the last {lately} here" if runs else "not measured on this machine yet"
    memory = max(plan.estimate.memory, *(stage.memory for stage in stages))
    return (
        f"about {duration(whole)}, {learned} ({', '.join(parts)}); "
        f"{memory / 1e9:.1f} GB of memory, {plan.estimate.disk / 1e6:.0f} MB of disk"
    )


def _parts(stages: Sequence[StageCost]) -> dict[str, float]:
    """Seconds under each heading, the longest first."""
    spent: dict[str, float] = {}
    for stage in stages:
        spent[stage.key.heading] = spent.get(stage.key.heading, 0.0) + stage.whole
    return dict(sorted(spent.items(), key=lambda item: -item[1]))
