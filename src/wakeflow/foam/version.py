"""Which OpenFOAM is installed."""

from __future__ import annotations

import re
from functools import cache

from ..core.errors import FoamError
from ..core.process import capture
from .case import INSTALL, environment

__all__ = ["openfoam_version"]


@cache
def openfoam_version() -> str:
    """Version and patch of the installed OpenFOAM, "1912 patch=200626". Raises FoamError when there is none."""
    command = ["simpleFoam", "-help"]
    code, text = capture(command, env=environment())
    if code != 0:
        raise FoamError(f"OpenFOAM's simpleFoam does not start; {INSTALL}", command=" ".join(command), tail=text[-500:])
    found = re.search(r"OpenFOAM-\s*\(?v?(\w+)\)?.*?\((patch=\w+)\)", text, re.S)
    return f"{found[1]} {found[2]}" if found else " ".join(text.split())[-80:]
