"""Each seeded fault is one of the program as it is, and the tests that must notice it are there."""

import pytest

from mutants import MUTANTS, ROOT, Mutant, found, places


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.fault)
def test_a_seeded_fault_has_its_place_and_its_tests(mutant: Mutant) -> None:
    assert len(places(mutant, ROOT / "src")) == 1, mutant.old
    assert found(mutant.tests), mutant.tests
