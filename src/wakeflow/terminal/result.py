"""The end of a run on a screen; the answer last."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.errors import known
from .budget import budget_table
from .shares import alone_table, separation_table
from .warn import warn

if TYPE_CHECKING:
    from ..funnel.delivered import FunnelSummary
    from ..results.airflow_summary import Airflow
    from ..results.result import Result

__all__ = ["show_result"]


def show_result(result: Result) -> None:
    """Print the budget, the funnel, the airflow, what pictures say, the gravest warnings, and last the answer."""
    from rich.console import Console

    console = Console()
    if result.landings is not None:
        console.print(budget_table(result.landings.budget))
    if result.funnel is not None:
        console.print(_poured(result.funnel), highlight=False)
    if result.airflow is not None:
        console.print(_air(result.airflow), highlight=False)
        if result.airflow.loading is not None:
            console.print(_loading(result), highlight=False)
    for name, picture in (result.pictures or {}).items():
        console.print(f"figures/{name}: {picture.text}", highlight=False, markup=False)
    if result.refinement is not None:
        for line in (*result.refinement.unmet, *result.refinement.measure):
            console.print(f"• {line}", highlight=False, markup=False)
    warn(console, result.warnings, result.grades)
    console.print(f"results: {result.folder}", highlight=False, soft_wrap=True)
    if result.landings is not None:  # the answer last: it is what stays in sight
        if result.landings.without_collisions is not None:
            console.print(alone_table(result.landings.separation, result.landings.without_collisions))
        console.print(separation_table(result, result.landings.separation))


def _air(airflow: Airflow) -> str:
    """The airflow in one line."""
    drop, cd, base = airflow.pressure_drop, airflow.cd, airflow.cp_base
    if cd is None or base is None:
        return f"airflow: {airflow.verdict}, {airflow.flow_rate:.3g} m²/s, pressure drop {drop:.2g} Pa"
    interval = f" [{cd.low:.3f}, {cd.high:.3f}]" if cd.known else ""  # none of a given case
    return (
        f"airflow: {airflow.verdict}, Cd {cd.value:.3f}{interval}, "
        f"base pressure coefficient {base.value:.2f}, pressure drop {drop:.1f} Pa"
    )


def _loading(result: Result) -> str:
    """What the granules' force on the air does, in one line."""
    loading = known(known(result.airflow).loading)
    told = (
        f"air loading: {loading.passes} pass{'es' if loading.passes != 1 else ''}, {loading.given:.2g} N/m on the air, "
        f"steady Cd {known(loading.cd_without).value:.3f} to {known(loading.cd).value:.3f}"
    )
    effects = None if result.landings is None else result.landings.air_loading
    if not effects:
        return told
    rows = [(name, place, found) for name, places in effects.items() for place, found in places.items()]
    name, place, most = max(rows, key=lambda row: abs(row[2].loaded - row[2].without))
    before, after = (f"{100 * share:.1f}" for share in (most.without, most.loaded))
    return f"{told}; " + (
        f"most moved: {name} in {place}, {before} to {after} %" if before != after else "no share moves"
    )


def _poured(funnel: FunnelSummary) -> str:
    """The feed funnel in one line."""
    rate, law = funnel.rate, funnel.beverloo_cone
    if rate is None:
        return f"funnel: {funnel.verdict} with {funnel.left} of {funnel.beads} beads inside"
    found = f"funnel: {1e3 * rate.value:.3g} g/s"
    if rate.known:
        found += f" [{1e3 * rate.low:.3g}, {1e3 * rate.high:.3g}]"
    empty = "" if funnel.time_to_empty is None else f", empty after {funnel.time_to_empty:.3g} s"
    return found + empty + ("" if law is None else f"; Beverloo's law with cone factor, at rest: {1e3 * law:.3g} g/s")
