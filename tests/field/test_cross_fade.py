"""A record made periodic keeps its variance, and nothing jumps where it joins."""

from __future__ import annotations

import numpy as np
import pytest

from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.field.cross_fade import cross_faded, fade

LEAD, COUNT, MEAN = 24, 480, 3.0
POINTS = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])


def record(samples: int, memory: float = 8.0, seed: int = 3) -> np.ndarray:
    """Independent signals (COUNT, samples) with an exponential memory of so many snapshots, of variance 1."""
    random = np.random.default_rng(seed)
    keep = np.exp(-1.0 / memory)
    rows = [random.normal(size=samples)]
    for _ in range(COUNT - 1):
        rows.append(keep * rows[-1] + np.sqrt(1 - keep**2) * random.normal(size=samples))
    return MEAN + np.array(rows)


def test_the_variance_is_kept_where_the_record_is_faded() -> None:
    faded = fade(record(4000), LEAD, positive=False)[-LEAD:]
    np.testing.assert_allclose(faded.var(axis=1), 1.0, atol=0.1)  # sampling: 3 sqrt(2 / 4000) = 0.07
    np.testing.assert_allclose(faded.mean(axis=1), MEAN, atol=0.07)


def test_it_joins_as_smoothly_as_it_runs() -> None:
    made = fade(record(4000), LEAD, positive=False)
    step = np.sqrt((np.diff(made, axis=0) ** 2).mean(axis=1))
    join = np.sqrt(((made[0] - made[-1]) ** 2).mean())
    assert join < 1.2 * np.median(step)
    assert len(made) == COUNT - LEAD


def test_what_is_not_faded_stays_and_what_is_positive_stays_so() -> None:
    values = np.abs(record(50))
    made = fade(values, LEAD, positive=True)
    np.testing.assert_array_equal(made[:-LEAD], values[LEAD:-LEAD])
    assert (made[-LEAD:] >= np.minimum(values[-LEAD:], values[:LEAD]) - 1e-12).all()
    assert (made[-LEAD:] <= np.maximum(values[-LEAD:], values[:LEAD]) + 1e-12).all()


def test_a_field_becomes_periodic() -> None:
    velocity = record(6).reshape(COUNT, 3, 2)
    field = FlowField.from_arrays(POINTS, [(0, 1, 2)], velocity, times=0.1 * np.arange(COUNT), k=np.ones((COUNT, 3)))
    made = cross_faded(field, LEAD)
    assert made.period == pytest.approx(0.1 * (COUNT - LEAD))
    assert made.k is not None
    np.testing.assert_allclose(made.k, 1.0)
    for other in (field.mean(), made):
        with pytest.raises(SceneError, match="do not repeat"):
            cross_faded(other, LEAD)
    with pytest.raises(SceneError, match="too few"):
        cross_faded(field, COUNT // 3)
