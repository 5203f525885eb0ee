"""What a user's own OpenFOAM case says of its air, read as text: nothing heavy is loaded, nothing is started."""

from __future__ import annotations

import gzip
import re
from pathlib import Path
from typing import Any

from ..core.errors import SceneError, known

__all__ = ["air_of", "find_case", "is_laminar"]

NUMBER = r"[-+.\d]+(?:[eE][-+]?\d+)?"
FIXED = r"type\s+(?:fixedValue|uniformFixedValue|inletOutlet)\s*;"


def find_case(given: str, base: Path) -> Path:
    """The case's folder, absolute; ``given`` is relative to ``base``. Raises SceneError where no case with a mesh and a
    solution is.
    """
    case = (base / Path(given).expanduser()).resolve()
    boundary = case / "constant" / "polyMesh" / "boundary"
    if not any(path.exists() for path in (boundary, boundary.with_name("boundary.gz"))):
        raise SceneError(f"air.case = {given!r}: no OpenFOAM mesh (constant/polyMesh) in {case}")
    if _latest(case) is None:
        raise SceneError(f"air.case = {given!r}: no solved time in {case}; run its solver (and reconstructPar) first")
    return case


def _latest(case: Path) -> Path | None:
    """The last time folder that holds a velocity, 0 left out."""
    found = [(float(p.name), p) for p in case.iterdir() if re.fullmatch(NUMBER, p.name) and p.name.count(".") <= 1]
    solved = [(time, p) for time, p in found if time > 0 and any((p / f).exists() for f in ("U", "U.gz"))]
    return max(solved)[1] if solved else None


def _text(path: Path) -> str:
    """A file's text, decompressed where it is packed, with binary parts as they are; empty where there is no file."""
    packed = path.with_name(path.name + ".gz")
    if path.exists():
        return path.read_bytes().decode("latin-1")
    return gzip.decompress(packed.read_bytes()).decode("latin-1") if packed.exists() else ""


def air_of(case: Path) -> dict[str, Any]:
    """What of ``speed`` (m/s), ``direction`` and ``nu`` (m2/s) the case says: its inlet where that is one uniform
    vertical velocity, and its constant viscosity. Streams across the channel are no inlet.
    """
    found: dict[str, Any] = {}
    folder = known(_latest(case))
    boundary = _text(folder / "U").rpartition("boundaryField")[2]
    speeds = set()
    for entry in re.findall(r"\{([^{}]*)\}", boundary):
        value = re.search(rf"\bvalue\s+uniform\s*\(\s*({NUMBER})\s+({NUMBER})\s+({NUMBER})\s*\)", entry)
        if re.search(r"type\s+(?:fixedValue|uniformFixedValue)\s*;", entry) and value:
            x, y = float(value[1]), float(value[2])
            if abs(y) > abs(x):
                speeds.add(y)
    if len(speeds) == 1:
        speed = speeds.pop()
        found = {"speed": abs(speed), "direction": "up" if speed > 0 else "down"}
    text = _text(case / "constant" / "transportProperties")
    parameters = _text(case / "system" / "parameters")
    for source in (text, parameters):
        nu = re.search(rf"^\s*nu\s+(?:nu\s+)?(?:\[[^\]]*\]\s*)?({NUMBER})\s*;", source, re.M)
        if nu and "nu" not in found:
            found["nu"] = float(nu[1])
    return found


def is_laminar(case: Path) -> bool:
    """Whether the case's solution has no turbulence: no k beside its velocity."""
    folder = known(_latest(case))
    return not any((folder / name).exists() for name in ("k", "k.gz"))
