"""A plan goes to another process as it is."""

from __future__ import annotations

import pickle

import pytest

from support import CASES
from wakeflow.planning.make import make_plan

SCENES = [path.stem for path in sorted(CASES.glob("*.toml")) if "[channel]" in path.read_text()]


@pytest.mark.parametrize("name", SCENES)
def test_a_plan_that_was_sent_is_the_same_and_stays_read_only(name: str) -> None:
    plan = make_plan(CASES / f"{name}.toml")
    sent = pickle.loads(pickle.dumps(plan))
    assert sent == plan
    assert [row.tracked for row in sent.fractions.values()] == [row.tracked for row in plan.fractions.values()]
    with pytest.raises(TypeError):
        sent.fractions["more"] = None
