"""Files that are shipped beside the code: scenes to start from and the OpenFOAM case template."""

from __future__ import annotations

import tomllib
from pathlib import Path

__all__ = ["case_template", "scene_templates"]


def _cases() -> Path:
    """``cases`` of the repository in an editable install, the copy inside the package in a wheel."""
    inside = Path(__file__).parents[1] / "cases"
    return inside if inside.is_dir() else Path(__file__).parents[3] / "cases"


def scene_templates() -> dict[str, Path]:
    """The shipped scenes by name; files that ask for many scenes of one are none."""
    files = sorted(_cases().glob("*.toml"))
    return {path.stem: path for path in files if not {"sweep", "search"} & tomllib.loads(path.read_text()).keys()}


def case_template() -> Path:
    """The OpenFOAM case that every airflow starts from."""
    return _cases() / "template"
