"""Files of the user's that a scene names: materials, drawings, vibration samples and an OpenFOAM case."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from ..core.errors import SceneError, known
from ..core.files import MAX_RECORD, read_packed, read_toml, read_whole
from ..core.quantities import quantity
from ..core.record import JsonMapping, JsonTable
from ..laws.material import Material, materials, read_material
from .drawing import with_drawings
from .machine import Air
from .own_path import own_path

# -- Materials of the user's own ---------------------------------------------------------------------------------------
SHAPED = ("rebound_scatter", "tangential_restitution")  # of granules whose shape is known, where they are not 0


def read_materials(path: Path) -> dict[str, Material]:
    """The materials of a file by their names. Raises SceneError, one line, where it is none."""
    try:
        tables = read_toml(path)
    except OSError as problem:
        raise SceneError(f"materials = {str(path)!r}: {problem.strerror}") from None
    found = {}
    for name, table in tables.items():
        if name in materials:
            raise SceneError(f"{path.name}: {name}: is a built-in material; give yours another name")
        if not isinstance(table, Mapping):
            raise SceneError(f"{path.name}: {name} = {table!r}: write [{name}] and its keys below it")
        found[name] = read_material(name, table, path.name)
    return found


def with_own_materials(data: JsonMapping, base: Path) -> JsonMapping:
    """The tables with what the file ``materials`` says in place of its name, so that results tell what was computed: a
    fraction of such a material has its values, but for those that it gives itself.

    Raises SceneError as :func:`read_materials` does.
    """
    file = data.get("materials")
    fractions = data.get("fraction", {})
    if not isinstance(file, str) or not isinstance(fractions, Mapping):
        return data
    known = read_materials(own_path(file, base, "materials"))
    found = {
        which: _as_fraction(which, known[table["material"]], table)
        if isinstance(table, Mapping) and table.get("material") in list(known)
        else table
        for which, table in fractions.items()
    }
    return {**{key: table for key, table in data.items() if key != "materials"}, "fraction": found}


def _as_fraction(which: object, material: Material, table: Mapping[str, object]) -> dict[str, object]:
    """The keys of the fraction ``which`` of a ``material``, those in its own ``table`` first; at its ``moisture`` where
    it has one.

    Raises SceneError as :meth:`Material.at_moisture` does.
    """
    if "moisture" in table:
        share = _share_of(table["moisture"])
        try:
            material = material.at_moisture(share)
        except SceneError as problem:
            raise SceneError(f"fraction.{which}.moisture = {100 * share:g} %: {problem}") from None
        table = {key: value for key, value in table.items() if key != "moisture"}
    values: dict[str, object] = {
        "size": material.diameter, "density": material.density, "impact": material.impact,
        "restitution": _spread(material, "restitution"), "friction": _spread(material, "friction"),
    }  # fmt: skip
    if material.terminal_velocity is not None and "sphericity" not in table:
        values["terminal_velocity"] = _spread(material, "terminal_velocity")
    values |= {key: _known(material, key, value) for key in SHAPED if (value := getattr(material, key))}
    if material.dimensions is not None:
        values["dimensions"] = list(material.dimensions)
    if "inertia" in table:
        del values["impact"]
    return {**values, **{key: value for key, value in table.items() if key != "material"}}


def _share_of(given: object) -> float:
    """A share of water as a scene writes it."""
    try:
        return quantity(given, "1", "14 %") if isinstance(given, str) else float(str(given))
    except ValueError:
        raise SceneError(f"moisture = {given!r}: needs a share, such as '14 %'") from None


def _spread(material: Material, key: str) -> object:
    """A number of all granules, or how it spreads over them."""
    mean, std = getattr(material, key), getattr(material, f"{key}_std")
    return _known(material, key, {"distribution": "normal", "mean": mean, "std": std} if std else mean)


def _known(material: Material, key: str, value: object) -> object:
    """A value with how well the material says that its own number is known, where it does."""
    half = material.evidence[key].uncertainty if key in material.evidence else None
    if half is None:
        return value
    return {**(value if isinstance(value, dict) else {"value": value}), "uncertainty": half}


# -- The tables of a scene with what the files say that it names -------------------------------------------------------
def with_own_files(data: JsonMapping, base: Path) -> JsonMapping:
    """The tables with the contents of a file of vibration samples, or of a drawing of a body, in place of its name, so
    that results tell what was computed; with the full path of the user's case, and what that says of its air where the
    scene does not give it.

    Raises SceneError as :func:`read_samples`, :func:`find_case` and :func:`with_drawings` do.
    """
    air, vibration, report, bodies = (data.get(key) for key in ("air", "vibration", "report", "body"))
    if isinstance(bodies, Mapping):
        data = {**data, "body": with_drawings(bodies, base)}
    if isinstance(report, Mapping) and isinstance(report.get("logo"), str):
        data = {**data, "report": {**report, "logo": str(_logo(report["logo"], base))}}
    if isinstance(air, Mapping) and isinstance(air.get("case"), str):
        data = {**data, "air": _of_case(air, base)}
    if isinstance(vibration, Mapping) and isinstance(vibration.get("samples"), str):
        data = {**data, "vibration": {**vibration, "samples": read_samples(vibration["samples"], base)}}
    return data


LOGOS = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


def _logo(given: str, base: Path) -> Path:
    """The file of a logo, absolute. Raises SceneError where it is none."""
    path = own_path(given, base, "report.logo").resolve()
    if path.suffix.lower() not in LOGOS:
        raise SceneError(f"report.logo = {given!r}: needs a file that ends in {', '.join(LOGOS)}")
    if not path.is_file():
        raise SceneError(f"report.logo = {given!r}: no file {path}")
    return path


def _of_case(air: JsonMapping, base: Path) -> JsonTable:
    case = find_case(air["case"], base)
    found = air_of(case)
    if (nu := found.pop("nu", None)) is not None:
        given = {key: air[key] for key in ("temperature", "pressure", "density") if key in air}
        with suppress(ValidationError):  # which the scene's own check says, naming the file
            found["viscosity"] = nu * Air(speed=0.0, **given).density
    if "speed" not in found and "speed" not in air:
        raise SceneError(f"air.case = {air['case']!r}: its inlet is not one uniform velocity; give air.speed")
    return {**found, **air, "case": str(case)}


FIGURES = re.compile(r"\s*[-+]?[.,]?[0-9]")  # no heading begins so


# -- A file of measured vibration --------------------------------------------------------------------------------------
def read_samples(given: str, base: Path) -> dict[str, list[float]]:
    """Times (s) and accelerations (m/s2) of a CSV file, its path relative to ``base``: two numbers a line, separated by
    commas, semicolons or tabs; lines before the first number and lines that begin with # are headings.

    Raises SceneError for a file that cannot be read, and for a line that is not two numbers, naming it.
    """
    path = own_path(given, base, "vibration.samples")
    try:
        lines = read_whole(path).decode("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        why = problem.strerror if isinstance(problem, OSError) else "not a text file"
        raise SceneError(f"vibration.samples = {given!r}: cannot read {path}: {why}") from None
    found: dict[str, list[float]] = {"time": [], "acceleration": []}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        separator = next((mark for mark in (";", "\t", ",") if mark in line), None)
        try:
            cells = next(csv.reader([line], delimiter=separator)) if separator else line.split()
            time, acceleration = map(float, cells)
        except (ValueError, csv.Error):
            if not found["time"] and not FIGURES.match(line):
                continue
            raise SceneError(
                f"vibration.samples = {given!r}: line {number} of {path.name} is {line.strip()[:40]!r}; every line "
                "needs two numbers with a decimal point, time in s and acceleration in m/s2; a note begins with #"
            ) from None
        found["time"].append(time)
        found["acceleration"].append(acceleration)
    if not found["time"]:
        raise SceneError(f"vibration.samples = {given!r}: no line of two numbers (time in s, acceleration in m/s2)")
    return found


# -- What a user's own OpenFOAM case says of its air, read as text -----------------------------------------------------
NUMBER = r"[-+.\d]+(?:[eE][-+]?\d+)?"


def find_case(given: str, base: Path) -> Path:
    """The case's folder, absolute; ``given`` is relative to ``base``. Raises SceneError where no case with a mesh and a
    solution is.
    """
    case = own_path(given, base, "air.case").resolve()
    boundary = case / "constant" / "polyMesh" / "boundary"
    if not any(path.exists() for path in (boundary, boundary.with_name("boundary.gz"))):
        raise SceneError(f"air.case = {given!r}: no OpenFOAM mesh (constant/polyMesh) in {case}")
    latest = _latest(case)
    if latest is None:
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
        return read_whole(path, MAX_RECORD).decode("latin-1")
    return read_packed(packed).decode("latin-1") if packed.exists() else ""


def air_of(case: Path) -> JsonTable:
    """What of ``speed`` (m/s), ``direction`` and ``nu`` (m2/s) the case says: its inlet where that is one uniform
    vertical velocity, and its constant viscosity. Streams across the channel are no inlet.
    """
    found: dict[str, object] = {}
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
