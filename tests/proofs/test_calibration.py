"""Calibrations where the truth is known: the trays that are made of it, one scene, and with --slow all of them."""

from __future__ import annotations

import numpy as np
import pytest

from proofs.coverage.calibrated import CHEAP, KINDS, cheap_scenes, exchanged, run_calibration, trays_of, true_shares
from proofs.coverage.flown import Predicted, predicted, with_bins
from wakeflow.core.store import Store, cache_root
from wakeflow.scene.measured import Measured, Tray


@pytest.fixture(scope="module")
def told() -> Predicted:
    store = Store(cache_root())
    return predicted(with_bins(cheap_scenes(1)[0], store), store)


def test_scenes_are_of_the_cheap_groups_in_turn() -> None:
    found = cheap_scenes(6)
    assert [one.group for one in found] == [*CHEAP, *CHEAP[:2]]
    assert found[:3] == cheap_scenes(3)


@pytest.mark.parametrize("kind", KINDS)
def test_trays_are_as_near_to_the_true_shares_as_they_say(told: Predicted, kind: str) -> None:
    true = true_shares(told)
    found = Measured.of(trays_of(told, kind, true))
    shares = told.separation.fractions
    places = [(name, place) for name, found_in in shares.items() for place in found_in]
    off = found.shares - found.weights(places, told.scene.mass_shares()) @ true
    assert np.all(np.abs(off) < 4.0 * np.sqrt(np.diag(found.covariance)) + 1e-3)
    assert sum(true) == pytest.approx(len(shares))


def test_the_labels_of_the_trays_that_differ_most_are_exchanged() -> None:
    trays = [Tray(fraction="a", bin=bin_, share=share, uncertainty=0.02)
             for bin_, share in (("left", 0.1), ("middle", 0.3), ("right", 0.6))]  # fmt: skip
    found = exchanged(trays)
    assert found is not None
    assert {tray.bin: tray.share for tray in found} == {"left": 0.6, "middle": 0.3, "right": 0.1}
    assert exchanged(trays[:1]) is None


def test_a_scene_is_calibrated_and_its_wrong_labels_are_found_out() -> None:
    # Draw 0 of this scene has the restitution of the fraction that is not weighed 2.6 deviations off: its shares lie
    # where one truth of a hundred does. In draw 1 no input is beyond the 95 % that are stated of it.
    found = run_calibration(scenes=1, draw=1)
    right, wrong = found.facts["checks"]
    assert (right["scenes"], right["found"]) == (1, 0)
    assert wrong["found"] == wrong["scenes"]
    shares, inputs, _ = found.facts["held"]
    assert shares["many"] > 2
    assert inputs["many"] > 5
    assert shares["coverage"] > 0.7
    assert inputs["coverage"] > 0.7


@pytest.mark.slow
def test_intervals_hold_the_truth_and_wrong_labels_are_found_out() -> None:
    assert run_calibration(slow=True).missed == []
