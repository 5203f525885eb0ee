"""The residence figure: how long granules of each fraction stay in the suction zone behind the first body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..air import SUCTION_LEVEL, as_flown, pressure_coefficient, suction_nodes
from ..canvas import new_axes, save
from ..colours import fraction_colours
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...field import FlowField
    from ...results.airflow_summary import Airflow
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome, Track

__all__ = ["draw_residence", "times_in_zone"]

Array = NDArray[np.float64]
SURE = 0.95
SPANS = "the zone spans the channel: this is the time of passing through it, not behind the body alone"


def times_in_zone(mean: FlowField, cp: Array, zone: NDArray[np.bool_], tracks: Sequence[Track]) -> Array:
    """How long (s) each of the tracks is in the suction zone: where ``cp`` (N,), the pressure coefficient at the nodes,
    is below its border in a triangle that has a node of the ``zone`` (N,).
    """
    found = np.zeros(len(tracks))
    for number, track in enumerate(tracks):
        middle = 0.5 * (track["position"][1:] + track["position"][:-1])
        triangle = mean.locate(middle)
        corner = mean.triangles[triangle]
        inside = np.zeros(len(middle), dtype=bool)
        met = triangle >= 0
        level = np.einsum("nk,nk->n", mean.barycentric(triangle[met], middle[met]), cp[corner[met]])
        inside[met] = (level < SUCTION_LEVEL) & zone[corner[met]].any(axis=1)
        found[number] = float(np.diff(track["time"])[inside].sum())
    return found


def draw_residence(
    paper: Paper, field: FlowField, scene: Scene, airflow: Airflow, tracks: Mapping[str, Sequence[Track]]
) -> Axes:
    """Draw of each fraction the share of its drawn tracks that stay longer in the suction zone than the time along the
    axis; in words the share that comes through it, and their median time with its 95 % interval. A zone from wall to
    wall is told: every granule crosses it, so that a long time may be a slow fall and no stay behind the body.
    """
    mean = as_flown(field.mean(), scene)
    cp = pressure_coefficient(mean, scene, airflow)
    zone = suction_nodes(mean, cp, scene)
    times = {name: times_in_zone(mean, cp, zone, part) for name, part in tracks.items() if part}
    axes, colours = new_axes(6.4, 3.9, paper), fraction_colours(list(scene.fraction))
    for name, found in times.items():
        stays = np.sort(found)
        share = 100.0 * (1.0 - np.arange(len(stays) + 1) / len(stays))
        axes.stairs(share, 1e3 * np.concatenate([[0.0], stays, [stays[-1]]]), baseline=None, color=colours[name],
                    linewidth=1.6, label=f"{name}: {_told(found)}")  # fmt: skip
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 102.0)
    axes.set_xlabel("time in the suction zone (ms)")
    axes.set_ylabel("share of the tracks that stay longer (%)")
    axes.grid(color="#dddddd", linewidth=0.5)
    across = airflow.suction is not None and airflow.suction.spans(scene.channel.width)
    axes.legend(
        title=SPANS if across else None, title_fontsize=7.5, alignment="left", fontsize=7.5,
        frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0),
    )  # fmt: skip
    sizes = [len(found) for found in times.values()]
    save(axes.figure, paper, {
        "fraction": np.repeat(list(times), sizes),
        "track": np.concatenate([np.arange(size) for size in sizes]),
        "time in the suction zone (s)": np.concatenate(list(times.values())),
    })  # fmt: skip
    return axes


def _told(times: Array) -> str:
    """``"94 % of 48 tracks, median 23 [21, 26] ms"``: order statistics bound the median without any law of times."""
    from scipy.stats import binom

    inside = np.sort(1e3 * times[times > 0.0])
    share = f"{100 * len(inside) / len(times):.0f} % of {len(times)} tracks"
    if not len(inside):
        return share
    last = len(inside) - 1
    lowest = int(binom.ppf(0.5 * (1.0 - SURE), len(inside), 0.5))
    low, high = inside[max(lowest - 1, 0)], inside[min(last - lowest + 1, last)]
    return f"{share}, median {np.median(inside):.3g} [{low:.3g}, {high:.3g}] ms"


def _needs(outcome: Outcome) -> bool:
    field, airflow = outcome.field, outcome.airflow
    if field is None or field.pressure is None or airflow is None or airflow.cd is None or not outcome.scene.body:
        return False
    return any(len(part) > 0 for part in outcome.tracks.values())


def _draw(paper: Paper, outcome: Outcome) -> Axes:
    assert outcome.field is not None
    assert outcome.airflow is not None
    return draw_residence(paper, outcome.field, outcome.scene, outcome.airflow, outcome.tracks)


figures.add(
    "residence",
    Figure(
        "Residence time in the suction zone (Cp < −0.5 in the mean, from the first body on), of the drawn tracks.",
        _draw,
        _needs,
    ),
)
