"""A record of an irregular wake made periodic: its end is faded into what came before its beginning.

No stretch of a turbulent record repeats, so that there is no loop to look for. The first snapshots of the record, the
lead-in, are taken off, and the last ones turn into them over the same time: the field that follows the end, the first
after the lead-in, is then the one that followed it in reality. Fluctuations about the mean over time are added with
weights a and b whose squares have the sum 1, so that their variance is that of the record where the two are
uncorrelated; mean and fluctuations are free of divergence, and so is the sum. What cannot be negative (k and its
dissipation) is weighted by a^2 and b^2.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from .flow import FlowField

__all__ = ["cross_faded", "fade"]

Array = NDArray[np.float64]
EVEN = 1e-3  # of the time between snapshots: how far they may be off an even spacing (OpenFOAM rounds times)
POSITIVE = ("k", "dissipation")
SIGNED = ("velocity", "pressure", "given_gradient")


def fade(values: Array, lead: int, *, positive: bool) -> Array:
    """Snapshots (t, ...) less the first ``lead`` of them, into which the last ``lead`` turn; (t - ``lead``, ...)."""
    loop = np.array(values[lead:])
    share = np.arange(1, lead + 1) / (lead + 1)
    a, b = (np.reshape(f(0.5 * np.pi * share), (lead, *[1] * (values.ndim - 1))) for f in (np.cos, np.sin))
    ending, before = values[len(values) - lead :], values[:lead]
    if positive:
        loop[len(loop) - lead :] = a**2 * ending + b**2 * before
    else:
        mean = loop.mean(axis=0)
        loop[len(loop) - lead :] = mean + a * (ending - mean) + b * (before - mean)
    return loop


def cross_faded(field: FlowField, lead: int) -> FlowField:
    """The periodic field of a record of evenly spaced snapshots: its first ``lead`` are faded into.

    Raises SceneError for a field that is not such a record, or has fewer than four times as many snapshots.
    """
    if field.times is None or field.period is not None or field.coefficients is not None:
        raise SceneError("cross_faded: the field must hold snapshots that do not repeat")
    step = np.diff(field.times)
    if len(field.times) < 4 * lead or lead < 1:
        raise SceneError(f"cross_faded: {len(field.times)} snapshots are too few to fade {lead} of them")
    if np.ptp(step) > EVEN * step.mean():
        raise SceneError("cross_faded: the snapshots are not evenly spaced in time")
    changes: dict[str, Any] = {
        name: fade(values, lead, positive=name in POSITIVE)
        for name in (*SIGNED, *POSITIVE)
        if (values := getattr(field, name)) is not None
    }
    count, mean = len(field.times) - lead, float(step.mean())
    changes["times"] = mean * np.arange(count)
    return replace(field, **changes, period=count * mean)
