"""Strides over many triangles fly every force, and the same noise as steps that stay inside a triangle."""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from proofs.problems.exact import box
from wakeflow.air.field import FlowField
from wakeflow.flight import Body, Fate, Granules, Tracks, track

PERIOD, COUNT, LENGTH = 0.4, 32, 0.1
FORCES = ("drag", "gravity", "pressure-gradient", "added-mass", "lift", "magnus")
FLOOR = np.array([[0.9, 0.02], [0.0, 0.02]])


def air(kind: str) -> FlowField:
    """Shear and a wave in a box of side 1 m, with turbulence: steady, as snapshots, as modes, on a mesh that swings."""
    points, triangles = box(64, low=0.0, high=1.0)
    times = np.arange(24) * PERIOD / 24
    x, y = points.T
    k = 0.2 + 0.3 * np.sin(np.pi * x) ** 2

    def velocity(t: float) -> np.ndarray:
        turn = 2 * np.pi * (x + t / PERIOD)
        return np.stack([1.0 + 0.5 * np.sin(2 * np.pi * y), 0.4 * np.cos(turn)], axis=1)

    def pressure(t: float) -> np.ndarray:
        return np.asarray(0.5 * np.sin(2 * np.pi * (x - t / PERIOD)))

    if kind == "steady":
        return FlowField.from_arrays(points, triangles, velocity(0.0), pressure(0.0), k=k, dissipation=20.0 * k)
    rows = [np.stack([make(t) for t in times]) for make in (velocity, pressure)]
    still = np.tile(k, (len(times), 1))
    field = FlowField.from_arrays(
        points, triangles, *rows, times=times, period=PERIOD, k=still, dissipation=20.0 * still
    )  # fmt: skip
    if kind == "snapshots":
        return field
    field = field.compressed(1e-4)
    return field.moving((0.0, 0.01), 4 * np.pi / PERIOD, 0.2) if kind == "moving" else field


def grains(diameter: float, density: float) -> Granules:
    rng = np.random.default_rng(4)
    return Granules(
        np.stack([rng.uniform(0.1, 0.4, COUNT), rng.uniform(0.8, 0.95, COUNT)], axis=1),
        np.stack([rng.uniform(-0.2, 0.2, COUNT), np.full(COUNT, -1.0)], axis=1),
        diameter, density, spin=200.0, time=rng.uniform(0.0, PERIOD, COUNT),
    )  # fmt: skip


SIZES = {"grain": (3e-3, 1300.0), "chaff": (1.5e-3, 60.0), "dust": (4e-5, 2000.0)}


def flown(field: FlowField, one: Granules, tolerance: float, *more: str, march: bool = True, **other: Any) -> Tracks:
    forces = (*FORCES, *more)
    laws: dict[str, Any] = {"until": 3.0, "lines": [FLOOR], "length": LENGTH, "forces": forces, "seed": 8} | other
    return track(field, one, tolerance=tolerance, march=march, **laws)


def off(one: Tracks, other: Tracks) -> np.ndarray:
    """How far landings lie apart, in lengths."""
    return np.asarray(np.linalg.norm(one.position - other.position, axis=1) / LENGTH)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("kind", ["steady", "snapshots", "modes"])
@pytest.mark.parametrize("past", [(), ("basset-history",)], ids=["", "history"])
def test_strides_with_every_force_land_where_confined_steps_do(kind: str, size: str, past: tuple[str, ...]) -> None:
    field, one = air(kind), grains(*SIZES[size])
    exact = flown(field, one, 1e-6, *past, march=False)
    for tolerance in (1e-2, 1e-4):
        found = flown(field, one, tolerance, *past)
        assert np.quantile(off(found, exact), 0.95) < tolerance
        np.testing.assert_allclose(found.spin, exact.spin, atol=30 * tolerance * np.abs(exact.spin).max())
    confined = flown(field, one, 1e-2, *past, march=False)
    assert flown(field, one, 1e-2, *past).evaluations.mean() < 0.5 * confined.evaluations.mean()


@pytest.mark.parametrize("size", ["grain", "chaff"])
@pytest.mark.parametrize("kind", ["steady", "snapshots", "modes", "moving"])
def test_any_tolerance_and_any_steps_fly_through_the_same_noise(kind: str, size: str) -> None:
    """What a granule sees of the eddies is fixed by seed and granule: landings differ by integration errors alone."""
    field, one = air(kind), grains(*SIZES[size])
    exact = flown(field, one, 1e-7, "dispersion", march=False)
    calm = flown(field, one, 1e-4)
    assert np.median(off(exact, calm)) > 5e-3  # the noise moves them
    for tolerance in (1e-3, 1e-4):
        assert np.quantile(off(flown(field, one, tolerance, "dispersion"), exact), 0.95) < tolerance


def test_strides_meet_walls_where_confined_steps_do() -> None:
    field, one = air("modes"), grains(*SIZES["grain"])
    body = Body(np.array([[0.5, 0.4], [0.4, 0.5], [0.3, 0.4], [0.4, 0.3]]), restitution=0.5)
    exact = flown(field, one, 1e-7, "dispersion", march=False, bodies=[body])
    found = flown(field, one, 1e-3, "dispersion", bodies=[body])
    np.testing.assert_array_equal(found.impacts > 0, exact.impacts > 0)
    assert 0 < (exact.impacts > 0).sum() < COUNT
    assert np.quantile(off(found, exact), 0.9) < 1e-2
    assert np.all(found.fate != Fate.STOPPED)


@pytest.mark.parametrize("kind", ["steady", "modes", "moving"])
@pytest.mark.parametrize("size", ["chaff", "dust"])
def test_no_stride_passes_a_line_unseen(kind: str, size: str) -> None:
    """Granules begin at rest, so that on the way down each stride is longer than the speed at its start foretells."""
    field, one = air(kind), grains(*SIZES[size])
    heights = np.geomspace(0.002, 0.3, COUNT)
    one = one.replace(position=np.stack([np.linspace(0.2, 0.7, COUNT), 0.3 + heights], axis=1), velocity=0.0)
    line = np.array([[1.0, 0.3], [0.0, 0.3]])
    found = flown(field, one, 0.1, "dispersion", lines=[line], gravity=(0.0, -60.0))
    first = found.fate == Fate.BINNED
    assert first.mean() > 0.5
    assert np.all(found.position[~first, 1] > 0.3)  # blown out at the side, none below the line


@pytest.mark.parametrize("size", SIZES)
def test_a_stride_that_would_meet_a_wall_sees_the_line_before_it(size: str) -> None:
    """A wall lies so near below the line that the stride across it meets the wall as well."""
    field, one = air("steady"), grains(*SIZES[size])
    one = one.replace(position=np.stack([np.linspace(0.3, 0.6, COUNT), np.linspace(0.35, 0.6, COUNT)], axis=1))
    wall = Body(np.array([[0.0, 0.1], [1.0, 0.1], [1.0, 0.29], [0.0, 0.29]]))
    line = np.array([[1.0, 0.3], [0.0, 0.3]])
    found = flown(field, one, 0.1, lines=[line], bodies=[wall], gravity=(0.0, -300.0))
    crossed = found.fate == Fate.BINNED
    assert crossed.mean() > 0.5
    np.testing.assert_array_equal(found.impacts, 0)
    np.testing.assert_allclose(found.position[crossed, 1], 0.3)


def test_the_air_that_is_kept_of_a_field_has_what_each_fraction_needs() -> None:
    """One flies without the pressure gradient, the next with it, in one field."""
    field, one = air("modes"), grains(*SIZES["chaff"])
    without = flown(field, one, 1e-4, "dispersion", forces=("drag", "gravity", "dispersion"))
    found = flown(field, one, 1e-4, "dispersion")
    fresh = flown(air("modes"), one, 1e-4, "dispersion")
    np.testing.assert_array_equal(found.position, fresh.position)
    assert np.all(off(found, without) > 0.0)


@pytest.mark.parametrize("kind", ["steady", "modes"])
def test_the_air_of_a_mirror_image_is_the_original_s_with_other_signs(kind: str) -> None:
    """Whether that is copied from the original's or made anew, every granule flies the same."""
    field, one = air(kind), grains(*SIZES["chaff"])
    mirrored = one.replace(position=one.position * (-1.0, 1.0))
    anew = flown(field.reflected(), mirrored, 1e-4, "dispersion")
    flown(field, one, 1e-4, "dispersion")  # so that there is one to copy
    np.testing.assert_array_equal(flown(field.image, mirrored, 1e-4, "dispersion").position, anew.position)


AT_A_WALL = """
import numpy as np
from wakeflow.flight import Body
from wakeflow.flight.driver import _rules
from wakeflow.flight.kernel import layout as at
from wakeflow.flight.kernel.dense_output import phis
from wakeflow.flight.kernel.strides import _end
from wakeflow.flight.pack_surroundings import pack_air, pack_lines, pack_walls
from flight.test_strides import air

field, h, radius = air("steady"), 1e-3, 2e-5
bodies = [Body(np.array([[0.5, 0.4], [0.4, 0.5], [0.3, 0.4], [0.4, 0.3]]))]
walls, packed = pack_walls(bodies, pack_lines([])), pack_air(field, bodies, 1e-6, ("drag",))
rules = _rules(field, packed, bodies, walls, 1.0, 1e-2, 0.1, 0, 1, True)
grain = np.zeros(at.CONSTANTS)
grain[at.RADIUS] = radius
for gap in (1e-16, 1e-12, 1e-6, 1e-4):
    path, state, ints = np.zeros(at.PATH), np.zeros(at.FLOATS), np.zeros(at.INTS, dtype=np.int64)
    place = np.array([0.45, 0.45]) + (radius + gap) * np.sqrt(0.5)
    path[[at.START_X, at.START_Y]], path[[at.START_VX, at.START_VY]] = place, -np.sqrt(0.5)
    ints[at.GAP] = -1
    ends, tri = phis(-path[at.RATE] * h), int(field.locate(place)[0])
    s, _, end = _end(path, h, ends, tri, state, ints, packed, grain, walls, rules, gap, h)
    print(s, ints[at.PATIENCE], *end[:2])
"""


def test_a_stride_that_begins_at_a_wall_moves_nothing_and_leaves_the_contact_to_a_confined_step() -> None:
    """Else it went a way that no number can hold, was taken for progress, and a granule did so a million times."""
    env = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run([sys.executable, "-c", AT_A_WALL], env=env, capture_output=True, text=True, check=True)
    for gap, row in zip((1e-16, 1e-12, 1e-6, 1e-4), run.stdout.splitlines(), strict=True):
        s, patience, x, y = (float(part) for part in row.split())
        assert patience == 1
        if gap > 1e-11:  # of which a stride of 1 mm goes more than a 1e-8
            assert s == pytest.approx(gap, rel=1e-3)
            assert (x + y - 0.9) * np.sqrt(0.5) > 2e-5
        else:
            assert s < 0.0
