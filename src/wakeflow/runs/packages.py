"""The packages that answers rest on."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass

__all__ = ["versions"]

PACKAGES = ("wakeflow", "numpy", "scipy", "numba", "gmsh", "meshio", "foamlib", "pyvista")


def versions() -> dict[str, str]:
    """Of python and of the packages that answers rest on."""
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": sys.version.split()[0]}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found
