"""What set-up installs: versions within the bounds of pyproject.toml, under licences that the program's own allows."""

import tomllib

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import dependencies
from support import ROOT


def locked() -> dict[str, str]:
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    return dict(line.split("==") for line in lines if not line.startswith("#"))


def test_the_lock_holds_every_dependency_within_its_bounds() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for text in [*project["dependencies"], *project["optional-dependencies"]["test"]]:
        asked = Requirement(text)
        if asked.name != "wakeflow":
            assert asked.specifier.contains(locked()[canonicalize_name(asked.name)], prereleases=True), text


def test_every_licence_is_listed_and_may_be_passed_on_with_the_program() -> None:
    page = (ROOT / "docs" / "reliability.md").read_text()
    packages = dependencies.needed()
    for name, made in packages.items():
        licence = dependencies.licence_of(made)
        assert dependencies.COMPATIBLE.search(licence), f"{name}: {licence}"
    assert not [name for name in locked() if f" {name}" not in page.replace(",", " ")]
