"""Shared by all tests: one cache for the whole session, so that parallel workers compute each airflow once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long validation as well")


def pytest_configure(config: pytest.Config) -> None:
    # Before any test module imports the tracker: its compiled kernel lives in the cache too. Kept between sessions.
    os.environ["WAKEFLOW_CACHE"] = str(ROOT / "runs" / ".test-cache")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("--slow"):
        skip = pytest.mark.skip(reason="long; add --slow")
        for item in items:
            if "slow" in item.keywords:
                item.add_marker(skip)


@pytest.fixture
def cases() -> Path:
    return ROOT / "cases"
