"""What answers are made for: scenes and requests, this program, and the packages that they rest on."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

from ..core.record import to_json
from ..core.sources import PACKAGE
from ..core.store import content_key, digest_files
from ..results.result import Request
from ..scene import Scene

PACKAGES = ("wakeflow", "numpy", "scipy", "numba", "gmsh", "meshio", "foamlib", "pyvista")


@cache
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


def answer_key(scene: Scene, request: Request, *more: Any) -> str:
    """What an answer is made for: the scene, the order of its tables, the request, whatever ``more`` there is, and all
    versions and sources.
    """
    order = [list(keyed) for keyed in (scene.body, scene.fraction, scene.bin)]
    return content_key(scene.tables(), order, to_json(request), *more, versions(), _sources())


@cache
def _sources() -> str:
    return digest_files([PACKAGE])
