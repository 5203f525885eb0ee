"""The joint answer: draws of all shares together, and the one maker of every interval."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest, norm

from support import shipped
from wakeflow.answer.cells import LandingCells
from wakeflow.answer.draws import DRAWS, INPUTS, LACK, ErrorSource, column, columns, tied_root
from wakeflow.answer.joint import JointAnswer, difference, middle
from wakeflow.answer.result import JOINT, Result
from wakeflow.answer.shares import JointRecord
from wakeflow.core.errors import SceneError
from wakeflow.core.own_files import SUMS
from wakeflow.core.record import from_json, to_json
from wakeflow.core.tables import load_arrays, save_arrays
from wakeflow.planning.unknowns import FARTHEST, SIGMAS

VACUUM = shipped("vacuum")
KEYS = ("air.speed", "fraction.soft.size", "fraction.hard.size")
SALT = "this run"


def own_cells() -> LandingCells:
    """Those of the shipped vacuum: near from 0 to 120 mm, far to 300 mm, of a floor from -300 to 300 mm."""
    return LandingCells.of(VACUUM, 2)


def made(
    *sources: ErrorSource, salt: str = SALT, slopes: tuple[float, float, float] = (0.03, 0.01, 0.02)
) -> JointAnswer:
    """An answer of two fractions: 0.6 and 0.3 near, 0.3 and 0.65 far, evenly over each bin; the air's speed carries
    both from near to far, a fraction's size itself alone.
    """
    cells, z = own_cells(), columns(KEYS)
    parts = cells.parts()
    even = parts / parts.sum(axis=0)
    base = np.array([[0.6, 0.3, 0.1], [0.3, 0.65, 0.05]]) @ even.T
    way = even[:, 1] - even[:, 0]
    by = np.stack([z[:, :2] @ slopes[:2], z[:, [0, 2]] @ np.array([slopes[0], slopes[2]])], axis=1)
    change = (by[:, :, None] * way).astype(np.float16).astype(np.float32)
    targets = {"soft": ("near",), "hard": ("far",)}
    return JointAnswer(
        ("soft", "hard"), np.array([0.25, 0.75]), targets, 1.0, cells, (), KEYS,
        z.astype(np.float32).astype(float), base, change, sources, salt,
    )  # fmt: skip


def sampling(half: float = 0.02) -> ErrorSource:
    return ErrorSource("sampling", np.stack([tied_root(np.full(3, half))] * 2))


def world(half: float = 0.02) -> ErrorSource:
    """A number of the world, that carries granules from near to far."""
    roots = half / SIGMAS * np.array([[-1.0], [1.0], [0.0]])
    return ErrorSource("collisions.restitution", np.stack([roots] * 2), computing=False, shared=True)


def bound(half: float) -> ErrorSource:
    roots = np.stack([tied_root(SIGMAS / np.sqrt(3.0) * np.full(3, half))] * 2)
    return ErrorSource("lift", roots, computing=False, bounded=True)


# -- columns -----------------------------------------------------------------------------------------------------------
def test_the_draws_of_a_key_are_the_same_in_every_answer_and_those_of_two_keys_go_apart() -> None:
    """One in each of as many equal parts of a normal distribution, in an order of its own."""
    one = column("air.speed").copy()
    column.cache_clear()
    assert np.array_equal(column("air.speed"), one)
    assert np.array_equal(np.sort(np.floor(norm.cdf(one) * DRAWS)), np.arange(DRAWS))
    assert kstest(one, "norm").statistic <= 1.0 / DRAWS
    keys = [f"key {i}" for i in range(40)]
    apart = np.corrcoef(np.stack([column(key) for key in keys])) - np.eye(len(keys))
    assert np.abs(apart).max() < 5.0 / np.sqrt(DRAWS)
    again = column("air.speed")
    with pytest.raises(ValueError, match="read-only"):
        again[0] = 0.0
    assert np.abs(columns(keys)).max() == FARTHEST
    assert columns([]).shape == (DRAWS, 0)


def test_an_input_has_the_same_draws_in_two_answers_and_what_is_a_runs_own_has_not() -> None:
    one, other = (made(sampling(), world(), salt=salt) for salt in ("one", "other"))
    assert np.array_equal(one.z, other.z)
    inputs = frozenset({INPUTS})
    assert np.array_equal(one.own.tables(inputs), other.own.tables(inputs))
    assert np.array_equal(one.errors["collisions.restitution"], other.errors["collisions.restitution"])
    apart = [
        np.corrcoef(a, b)[0, 1] for a, b in zip(*(x.errors["sampling"][:, 0].T for x in (one, other)), strict=True)
    ]
    assert np.abs(apart).max() < 5.0 / np.sqrt(DRAWS)


def test_the_fractions_have_draws_of_their_own_unless_they_go_together() -> None:
    for together in (False, True):
        errors = made(replace(sampling(), together=together)).errors["sampling"]
        alike = abs(np.corrcoef(errors[:, 0, 0], errors[:, 1, 0])[0, 1])
        assert (alike > 0.99) if together else (alike < 0.1)


# -- tables and numbers ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("half", [0.02, 0.3, 1.0])
def test_every_table_of_shares_is_one(half: float) -> None:
    """None below 0 or above 1, and they sum to 1, however large the errors are, also where they take all from every
    bin that has some.
    """
    loose = ErrorSource("loose", np.stack([half / SIGMAS * np.eye(3)] * 2))
    joint = made(sampling(half), bound(half), world(half), loose)
    for ends in ({}, {"near": (-0.1, 0.08), "far": (0.15, 0.2)}):
        tables = joint.moved(ends).tables()
        assert tables.shape == (1, DRAWS, 2, 3)
        assert tables.min() >= 0.0
        assert tables.max() <= 1.0 + 1e-12
        np.testing.assert_allclose(tables.sum(axis=-1), 1.0, rtol=1e-12)


def test_a_number_is_the_middle_of_what_its_function_is_in_the_draws() -> None:
    own = made(sampling(), world(), bound(0.03)).own
    for name in ("share.soft.near", "recovery.hard", "purity.near.soft", "purity.far.hard", "share.hard.elsewhere",
                 "loss.soft", "dirt.far"):  # fmt: skip
        of = own.of_name(name)
        assert of is not None
        found, values = own.number(of), of(own.tables())[0]
        assert (found.low, found.high) == pytest.approx(tuple(np.quantile(values, [0.025, 0.975])), rel=1e-12)
        assert found.value == pytest.approx(float(of(own.value)))
        assert np.mean((values >= found.low) & (values <= found.high)) == pytest.approx(0.95, abs=2.0 / DRAWS)
        computed = of(own.tables(frozenset({"sampling"})))[0]
        assert found.numerical == pytest.approx(0.5 * np.ptp(np.quantile(computed, [0.025, 0.975])))
    assert [own.of_name(name) for name in ("share.soft.nowhere", "purity.near.none", "airflow.cd", "recovery")] == [
        None
    ] * 4


def test_what_is_independent_adds_up_in_squares() -> None:
    """Ends of 2048 draws are known to 3 % of the half."""
    arms = made().own.share("soft", "near").half, SIGMAS * np.hypot(0.03, 0.01)
    assert arms[0] == pytest.approx(arms[1], rel=0.03)
    found = made(sampling(0.05), world(0.04)).own.share("soft", "near")
    assert found.half == pytest.approx(np.sqrt(arms[1] ** 2 + 0.05**2 + 0.04**2), rel=0.03)
    assert found.numerical == pytest.approx(0.05, rel=0.03)
    both = made(bound(0.05)).own.share("soft", "near").half  # a rectangle's variance
    assert both == pytest.approx(np.hypot(arms[1], SIGMAS / np.sqrt(3.0) * 0.05), rel=0.05)


def test_shares_purities_and_recoveries_of_one_draw_agree() -> None:
    """Purity is no sum: it is taken from the shares of all fractions in the same draw."""
    own = made(sampling(0.1), world()).own
    table = own.tables()[0]
    inside = np.array([0.25, 0.75]) * table[:, :, 0]
    pure = own.of_purity("near", "soft")(own.tables())[0]
    np.testing.assert_allclose(pure, inside[:, 0] / inside.sum(axis=1))
    both = own.number(own.of_share("soft", ["near", "far", "elsewhere"]))
    assert both == pytest.approx((1.0, 1.0, 1.0))
    assert own.number(own.of_share("soft", ["near"])) == own.number(own.of_name("recovery.soft"))
    complement = own.number(own.of_share("soft", ["far", "elsewhere"]))
    assert complement.half == pytest.approx(own.share("soft", "near").half)
    flow = own.of_name("throughput.near")
    assert float(flow(own.value)) == pytest.approx(3600 * (0.25 * 0.6 + 0.75 * 0.3))


def test_what_is_lost_and_what_is_dirt_is_what_recovery_and_purity_leave() -> None:
    """In every draw; dirt is what has no target there too, and a bin that is nobody's target has none."""
    joint = made(sampling(0.1), world())
    tables = joint.own.tables()

    def of(name: str, answer: JointAnswer = joint) -> np.ndarray:
        found = answer.own.of_name(name)
        assert found is not None
        return found(tables)

    np.testing.assert_allclose(of("loss.soft"), 1.0 - of("recovery.soft"), atol=1e-12)
    np.testing.assert_allclose(of("lost.soft"), 900.0 * of("loss.soft"))
    np.testing.assert_allclose(of("dirt.near"), 1.0 - of("purity.near.soft"), atol=1e-12)
    told = joint.own.separation()
    assert told.lost["hard"] == pytest.approx(tuple(2700.0 * one for one in told.loss["hard"]))
    assert told.dirt["elsewhere"] is None
    shared = replace(joint, targets={"soft": ("near", "far"), "hard": ("far",)})
    np.testing.assert_allclose(of("loss.soft", shared), of("share.soft.elsewhere"))
    np.testing.assert_allclose(of("dirt.far", shared), 0.0)
    alone = replace(joint, targets={"soft": ("near",), "hard": ()})
    np.testing.assert_allclose(of("dirt.near", alone), of("purity.near.hard"))
    assert alone.own.of_name("loss.hard") is None
    assert alone.own.of_name("dirt.far") is None


def test_an_empty_bin_has_the_answers_own_purity_in_draws_that_have_none() -> None:
    values = made(bound(1.0)).own.values(lambda table: np.where(table[..., 0, 0] > 0.0, table[..., 0, 0], np.nan))
    assert np.isfinite(values).all()
    assert 0.6 in values.round(12)


@pytest.mark.parametrize("held", ["sampling", "collisions.restitution", "lift", INPUTS])
def test_a_source_that_is_held_contributes_nothing(held: str) -> None:
    """To none of the tables; and all others do what they did."""
    sources = {one.name: one for one in (sampling(0.05), world(0.04), bound(0.05))}
    every = made(*sources.values())
    used = frozenset({*sources, INPUTS}) - {held}
    without = made(*(one for name, one in sources.items() if name != held))
    if held == INPUTS:
        without = replace(without, change=np.zeros_like(without.change))
    np.testing.assert_allclose(every.own.tables(used), without.own.tables(), atol=1e-12)
    assert np.abs(every.own.tables(used) - every.own.tables()).max() > 0.02
    assert every.own.tables(frozenset({"no such source"})) == pytest.approx(np.broadcast_to(
        every.own.value, (1, DRAWS, 2, 3)))  # fmt: skip


def test_a_bin_that_is_moved_takes_its_part_of_every_error() -> None:
    joint = made(sampling(0.04))
    near = joint.moved({"near": (0.0, 0.06)})  # half of what was near, evenly
    assert near.share("soft", "near").value == pytest.approx(0.3)
    quiet = frozenset({"sampling"})
    whole, part = (bins.of_share("soft", ["near"])(bins.tables(quiet))[0] for bins in (joint.own, near))
    assert part.std() == pytest.approx(0.5 * whole.std(), rel=0.02)
    # What is off in the bins that moved is less where these hold less: the shares of a draw are still a whole
    assert near.share("soft", "far") == pytest.approx(joint.own.share("soft", "far"), rel=1e-3)


def test_two_sides_of_a_mirrored_machine_have_the_same_number() -> None:
    """Bin by bin, also for what moves all to one side; what is on neither is as it was."""
    scene = shipped("rhombus", {"numerics.rung": "none"})
    cells, chance = LandingCells.of(scene, 1), np.random.default_rng(1)
    assert scene.images
    images = cells.mirrored(scene.images)
    assert np.array_equal(images[images], np.arange(cells.count))
    base = chance.dirichlet(np.ones(cells.count))[None]
    base = 0.5 * (base + base[:, images])
    keys = ("feed.position", "fraction.wheat.size")
    z, way = columns(keys), chance.normal(size=(2, cells.count)) * base
    change = (0.2 * z @ (way - base * way.sum(axis=1, keepdims=True)))[:, None].astype(np.float32)
    errors = ErrorSource("sampling", 0.01 * chance.normal(size=(1, len(scene.bin) + 1, 4)))
    joint = JointAnswer(
        ("wheat",), np.ones(1), {"wheat": ("outer-left",)}, 1.0, cells, scene.images, keys, z, base, change, (errors,)
    )
    own = joint.own
    assert own.tables().shape[0] == 2
    np.testing.assert_allclose(own.tables()[1], own.tables()[0][..., list(scene.images)], atol=1e-6)
    for place in ("outer", "inner"):
        left, right = (own.share("wheat", f"{place}-{side}") for side in ("left", "right"))
        assert left == right
        values = own.values(own.of_share("wheat", [f"{place}-left"]))
        assert np.std(values[0]) != pytest.approx(np.std(values[1]), rel=1e-3)  # that is not so by itself
    moved = joint.moved({"outer-left": (-0.2, -0.15), "outer-right": (0.15, 0.2)})
    assert tuple(moved.share("wheat", "outer-left")) == pytest.approx(
        tuple(moved.share("wheat", "outer-right")), rel=1e-6
    )


# -- the interval of values --------------------------------------------------------------------------------------------
def test_the_value_is_within_its_interval_and_parts_of_a_whole_within_0_and_1() -> None:
    """Also where all draws lie on one side of the answer, or beyond what can be."""
    above = middle(np.linspace(0.6, 0.7, 101)[None], 0.5)
    assert (above.low, above.value) == (0.5, 0.5)
    assert above.high == pytest.approx(0.6975)
    wide = middle(np.linspace(-1.0, 2.0, 101)[None], 0.5, bounds=(0.0, 1.0))
    assert (wide.low, wide.high) == (0.0, 1.0)
    pair = middle(np.stack([np.linspace(0.0, 1.0, 401), np.linspace(0.2, 1.2, 401)]), 0.5)
    assert (pair.low, pair.high) == pytest.approx((0.125, 1.075))  # of the two sides' ends the mean


def test_of_two_answers_what_both_do_not_know_goes_out() -> None:
    """Of an answer and itself on another salt only what is each run's own stays."""
    one, other, still = (made(sampling(0.03), world(0.05), bound(0.02), salt=salt).own for salt in ("a", "b", "a"))
    for name in ("share.soft.near", "recovery.hard", "purity.far.hard", "throughput.near"):
        assert tuple(difference(one, still, name)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    found = difference(one, other, "share.soft.near")
    own = np.sqrt(2.0) * np.hypot(0.03, SIGMAS / np.sqrt(3.0) * 0.02)
    assert found.value == pytest.approx(0.0, abs=1e-12)
    assert found.half == pytest.approx(own, rel=0.05)
    assert found.half < 0.6 * np.hypot(one.share("soft", "near").half, other.share("soft", "near").half)
    shifted = made(sampling(0.03), world(0.05), bound(0.02), slopes=(0.05, 0.01, 0.02), salt="b").own
    more = difference(one, shifted, "share.soft.near").half  # of an input that does more in one of them
    assert more == pytest.approx(np.hypot(own, 0.02 * SIGMAS), rel=0.05)
    assert difference(one, other, "airflow.cd") is None


# -- what inputs do ----------------------------------------------------------------------------------------------------
def test_an_input_does_what_it_does_alone() -> None:
    own = made(sampling(0.01)).own
    found = own.effects(own.of_share("soft", ["near"]), "soft")
    assert list(found) == ["air.speed", "fraction.soft.size"]  # the size of hard does nothing to soft
    rises = [one.rise for one in found.values()]
    assert rises == pytest.approx([-SIGMAS * 0.03, -SIGMAS * 0.01], rel=0.01)
    assert [one.variance for one in found.values()] == pytest.approx([0.9, 0.1], abs=0.03)  # draws go by 0.02 together
    assert all(one.half == abs(one.rise) and one.tells for one in found.values())
    assert [one.uncertainty for one in found.values()] == pytest.approx([0.5 * 0.01] * 2, rel=0.1)  # of few granules
    purity = own.effects(own.of_purity("near", "soft"))
    assert set(purity) == set(KEYS)
    assert made(sampling(), slopes=(0.0, 0.0, 0.0)).own.effects(own.of_share("soft", ["near"]), "soft") == {}


def test_what_the_fit_to_the_draws_does_not_know_is_the_error_of_an_effect() -> None:
    vague = ErrorSource(LACK, np.stack([tied_root(np.full(3, 0.2))] * 2), computing=False)
    sure, unsure = (made(*more).own for more in ((), (vague,)))
    parts = [one.effects(one.of_share("soft", ["near"]), "soft")["fraction.soft.size"] for one in (sure, unsure)]
    assert parts[0].tells
    assert not parts[1].tells


def test_known_better_is_never_below_what_computing_adds_and_never_wider_than_now() -> None:
    own = made(sampling(0.05), world(0.02)).own
    for name in ("share.soft.near", "recovery.hard", "purity.near.soft"):
        of = own.of_name(name)
        now, halves = own.number(of), []
        for part in (1.0, 0.75, 0.5, 0.25, 0.0):
            halves.append(own.known_better(of, dict.fromkeys(KEYS, part)).half)
            alone = own.known_better(of, {"air.speed": part}).half
            assert halves[-1] - 1e-3 <= alone <= now.half + 1e-9
        assert halves[0] == pytest.approx(now.half, rel=1e-9)
        assert halves == sorted(halves, reverse=True)
        assert halves[-1] >= now.numerical
    of = own.of_share("soft", ["near"])
    exact = own.known_better(of, dict.fromkeys(KEYS, 0.0))
    assert exact.half == pytest.approx(np.hypot(0.05, 0.02), rel=0.03)  # of 2048 draws
    half = own.known_better(of, {"air.speed": 0.5}).half
    assert half == pytest.approx(np.sqrt(0.05**2 + 0.02**2 + SIGMAS**2 * (0.015**2 + 0.01**2)), rel=0.03)


# -- in a run's folder -------------------------------------------------------------------------------------------------
def test_an_answer_comes_back_to_the_last_digit(tmp_path: Path) -> None:
    lack = np.float32(0.01 * columns(["a", "b"]))[:, :, None] * np.float32([1.0, -1.0, 0.0])
    given = ErrorSource("lack of fit", np.zeros((2, 3, 0)), computing=False, given=lack.astype(float))
    joint = made(sampling(), given, world(), bound(0.03))
    save_arrays(tmp_path / JOINT, joint.arrays())
    record = from_json(JointRecord, json.loads(json.dumps(to_json(joint.record()))), "record")
    again = JointAnswer.of(record, load_arrays(tmp_path / JOINT, "do it again"))
    assert again.own.separation() == joint.own.separation()
    ends = {"near": (0.01, 0.1)}
    assert again.moved(ends).separation() == joint.moved(ends).separation()
    assert np.array_equal(again.own.tables(), joint.own.tables())
    assert again.record() == joint.record()
    assert all(np.array_equal(array, joint.arrays()[name]) for name, array in again.arrays().items())


def test_a_run_that_is_read_again_has_the_same_joint_answer(small_run: Result) -> None:
    again = Result.load(small_run.folder).joint
    assert again.own.separation() == small_run.joint.own.separation()
    assert replace(again.own.separation(), cut=small_run.landings.separation.cut) == small_run.landings.separation
    name = "recovery.hard"
    assert tuple(difference(again.own, small_run.joint.own, name)) == (0.0, 0.0, 0.0)


CHANGES = {
    "no array": lambda arrays: arrays.pop("change"),
    "no root": lambda arrays: arrays.pop("root.0"),
    "no edges": lambda arrays: arrays.pop("edges.floor"),
    "fewer draws": lambda arrays: arrays.update(change=arrays["change"][:-1], z=arrays["z"][:-1]),
    "fewer cells": lambda arrays: arrays.update(base=arrays["base"][:, :-1]),
    "fewer fractions": lambda arrays: arrays.update(mass=arrays["mass"][:-1]),
    "words": lambda arrays: arrays.update(base=np.full(arrays["base"].shape, "much")),
    "a root of other bins": lambda arrays: arrays.update({"root.0": arrays["root.0"][:, :-1]}),
    "errors of other draws": lambda arrays: arrays.update({"given.0": arrays["given.0"][:-1]}),
    "no numbers": lambda arrays: arrays.update(base=np.full(arrays["base"].shape, np.nan)),
}


@pytest.mark.parametrize("how", list(CHANGES))
def test_damaged_arrays_are_refused_by_one_line(how: str, small_run: Result, tmp_path: Path) -> None:
    """Even where no checksum tells of it."""
    shutil.copytree(small_run.folder, tmp_path / "run")
    (tmp_path / "run" / SUMS).unlink()
    arrays = dict(load_arrays(tmp_path / "run" / JOINT, ""))
    CHANGES[how](arrays)
    save_arrays(tmp_path / "run" / JOINT, arrays)
    with pytest.raises(SceneError, match=r"joint.npz is damaged; make it again with: wakeflow run") as told:
        _ = Result.load(tmp_path / "run").joint
    assert "\n" not in str(told.value)


def test_arrays_that_are_missing_or_changed_are_named(small_run: Result, tmp_path: Path) -> None:
    shutil.copytree(small_run.folder, tmp_path / "run")
    file = tmp_path / "run" / JOINT
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(SceneError, match=r"joint.npz .*make it again with: wakeflow run"):
        _ = Result.load(tmp_path / "run").joint
    file.unlink()
    with pytest.raises(SceneError, match=r"holds no joint.npz; make it again with: wakeflow run"):
        _ = Result.load(tmp_path / "run").joint
    with pytest.raises(SceneError, match="ended before them"):
        _ = replace(small_run, landings=None).joint
