"""Files of the user's that a scene names: materials, drawings, vibration samples and an OpenFOAM case."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from ..core.errors import FoamError, SceneError
from ..core.files import read_toml, user_path
from ..core.foam_text import Entries, read_entries
from ..core.quantities import quantity, split_quantity
from ..core.record import JsonMapping, JsonTable
from ..core.registry import Registry
from ..core.tables import Sheet, read_sheet
from ..laws.material import Material, materials, read_material
from .machine import Air
from .overrides import share_in

# -- Materials of the user's own ---------------------------------------------------------------------------------------
SHAPED = ("rebound_scatter", "tangential_restitution")  # of granules whose shape is known, where they are not 0


def read_materials(path: Path) -> dict[str, Material]:
    """The materials of a file by their names. Raises SceneError, one line, where it is none."""
    try:
        tables = read_toml(path)
    except OSError as problem:
        raise SceneError(f"materials = {str(path)!r}: {problem.strerror}") from None
    result = {}
    for name, table in tables.items():
        if name in materials:
            raise SceneError(f"{path.name}: {name}: is a built-in material; give yours another name")
        if not isinstance(table, Mapping):
            raise SceneError(f"{path.name}: {name} = {table!r}: write [{name}] and its keys below it")
        result[name] = read_material(name, table, path.name)
    return result


def with_own_materials(data: JsonMapping, base: Path) -> JsonMapping:
    """The tables with what the file ``materials`` says in place of its name, so that results tell what was computed: a
    fraction of such a material has its values, but for those that it gives itself.

    Raises SceneError as :func:`read_materials` does.
    """
    file = data.get("materials")
    fractions = data.get("fraction", {})
    if not isinstance(file, str) or not isinstance(fractions, Mapping):
        return data
    known = read_materials(user_path(file, base, "materials"))
    result = {
        which: _as_fraction(which, known[table["material"]], table)
        if isinstance(table, Mapping) and table.get("material") in list(known)
        else table
        for which, table in fractions.items()
    }
    return {**{key: table for key, table in data.items() if key != "materials"}, "fraction": result}


def _as_fraction(which: object, material: Material, table: Mapping[str, object]) -> dict[str, object]:
    """The keys of the fraction ``which`` of a ``material``, those in its own ``table`` first; at its ``moisture`` where
    it has one.

    Raises SceneError as :meth:`Material.at_moisture` does.
    """
    if "moisture" in table:
        share = share_in(table["moisture"], "moisture")
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
    if material.dimensions:
        values["dimensions"] = list(material.dimensions)
    if "inertia" in table:
        del values["impact"]
    return {**values, **{key: value for key, value in table.items() if key != "material"}}


def _spread(material: Material, key: str) -> object:
    """A number of all granules, or how it spreads over them."""
    mean, std = getattr(material, key), getattr(material, f"{key}_std")
    return _known(material, key, {"distribution": "normal", "mean": mean, "std": std} if std else mean)


def _known(material: Material, key: str, value: object) -> object:
    """A value with how well the material says that its own number is known, where it does."""
    half = material.half_of(key, -1.0)
    if half < 0.0:
        return value
    return {**(value if isinstance(value, dict) else {"value": value}), "uncertainty": half}


# -- The tables of a scene with what the files say that it names -------------------------------------------------------
def with_own_files(data: JsonMapping, base: Path) -> JsonMapping:
    """The tables with the contents of a file of vibration samples, or of a drawing of a body, in place of its name, so
    that results tell what was computed; with the full path of the user's case, and what that says of its air where the
    scene does not give it.

    Raises SceneError as :func:`read_samples`, :func:`find_case` and the reader of a drawing do.
    """
    keys = "air", "vibration", "report", "body", "fraction"
    air, vibration, report, bodies, fractions = (data.get(key) for key in keys)
    if isinstance(bodies, Mapping):
        data = {**data, "body": {name: _drawn(name, table, base) for name, table in bodies.items()}}
    if isinstance(report, Mapping) and isinstance(report.get("logo"), str):
        data = {**data, "report": {**report, "logo": str(_logo(report["logo"], base))}}
    if isinstance(air, Mapping) and isinstance(air.get("case"), str):
        data = {**data, "air": _of_case(air, base)}
    if isinstance(fractions, Mapping):
        data = {**data, "fraction": {name: _sieved(name, table, base) for name, table in fractions.items()}}
    if isinstance(vibration, Mapping) and isinstance(vibration.get("samples"), str):
        data = {**data, "vibration": {**vibration, "samples": read_samples(vibration["samples"], base)}}
    return data


# A drawing's file, what its path is relative to, its unit and layer, to corners (m); in the registry under DXF
OutlineReader = Callable[[str, Path, object, object], list[list[float]]]
DXF = "dxf"
drawings: Registry[OutlineReader] = Registry("kind of drawing", extended=True)


def _drawn(name: object, table: object, base: Path) -> object:
    """The table of a body, with the corners of its drawing in place of the name of one. Raises SceneError as the reader
    does, with the body's name, and where the body has another shape too.
    """
    if not isinstance(table, Mapping) or not isinstance(file := table.get("outline"), str):
        return table
    if table.get("shape", "polygon") != "polygon" or "points" in table:
        raise SceneError(f"body.{name}: outline = {file!r} is its shape; delete shape and points")
    try:
        points = drawings[DXF](file, base, table.get("outline_unit"), table.get("outline_layer"))
    except SceneError as problem:
        raise SceneError(f"body.{name}: {problem}") from None
    others = {key: value for key, value in table.items() if key not in ("outline", "outline_unit", "outline_layer")}
    return {"shape": "polygon", **others, "points": points}


def _sieved(name: object, table: object, base: Path) -> object:
    """A fraction with the sieve analysis in place of its file. Raises SceneError as :func:`read_sieves` does."""
    size = table.get("size") if isinstance(table, Mapping) else None
    if not isinstance(size, Mapping) or not isinstance(file := size.get("file"), str):
        return table
    if set(size) - {"file", "distribution"} or size.get("distribution", "table") != "table":
        raise SceneError(f"fraction.{name}.size.file = {file!r} says all of it; delete the other keys")
    return {**table, "size": read_sieves(file, base, f"fraction.{name}.size.file")}  # type: ignore[dict-item]


LOGOS = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


def _logo(given: str, base: Path) -> Path:
    """The file of a logo, absolute. Raises SceneError where it is none."""
    path = user_path(given, base, "report.logo").resolve()
    if path.suffix.lower() not in LOGOS:
        raise SceneError(f"report.logo = {given!r}: needs a file that ends in {', '.join(LOGOS)}")
    if not path.is_file():
        raise SceneError(f"report.logo = {given!r}: no file {path}")
    return path


def _of_case(air: JsonMapping, base: Path) -> JsonTable:
    case = find_case(air["case"], base)
    result = air_of(case)
    if (nu := result.pop("nu", None)) is not None:
        given = {key: air[key] for key in ("temperature", "pressure", "density") if key in air}
        with suppress(ValidationError):  # which the scene's own check says, naming the file
            result["viscosity"] = nu * Air(speed=0.0, **given).density
    if "speed" not in result and "speed" not in air:
        raise SceneError(f"air.case = {air['case']!r}: its inlet is not one uniform velocity; give air.speed")
    return {**result, **air, "case": str(case)}


# -- A file of measured vibration --------------------------------------------------------------------------------------
def read_samples(given: str, base: Path) -> dict[str, list[float]]:
    """Times (s) and accelerations (m/s2) of a CSV file, its path relative to ``base``: two numbers a line, as
    :func:`~wakeflow.core.tables.read_sheet` reads them; lines before the first number are headings, of which the last
    may name other units, such as time (ms) and acceleration (g).

    Raises SceneError for a file that cannot be read, and for a line that is not two numbers, naming it.
    """
    path, result = user_path(given, base, "vibration.samples"), {"time": list[float](), "acceleration": list[float]()}
    for at, cells in _sheet(path, f"vibration.samples = {given!r}", headed=False).rows:
        try:
            time, acceleration = cells
            pair = _in("s", time), _in("m/s^2", re.sub(r"(?<=[0-9 ])g$", "standard_gravity", acceleration))
        except ValueError:
            raise SceneError(
                f"vibration.samples = {given!r}: {at} is {' '.join(cells)[:40]!r}; every line needs two numbers, time "
                "in s and acceleration in m/s2; a note begins with #"
            ) from None
        for values, value in zip(result.values(), pair, strict=True):
            values.append(value)
    if not result["time"]:
        raise SceneError(f"vibration.samples = {given!r}: no line of two numbers (time in s, acceleration in m/s2)")
    return result


def _sheet(path: Path, key: str, *, headed: bool = True) -> Sheet:
    """The table in a file. Raises SceneError that begins with the ``key``."""
    try:
        return read_sheet(path, headed=headed)
    except SceneError as problem:
        raise SceneError(f"{key}: {problem}") from None
    except OSError as problem:
        raise SceneError(f"{key}: cannot read {path}: {problem.strerror}") from None


def _in(unit: str, cell: str) -> float:
    """A cell as a number in ``unit``, which it is in where it has none. Raises ValueError where it is none."""
    parts = split_quantity(cell)
    if parts is None:
        raise ValueError(cell)
    return quantity(cell, unit, f"1 {unit}") if parts[1] else parts[0]


# -- A file of a sieve analysis ----------------------------------------------------------------------------------------
OPENINGS = ("opening", "size", "diameter", "sieve", "mesh", "aperture", "maschenweite", "korngröße", "siebweite")
PASSING = ("passing", "finer", "undersize", "durchgang", "siebdurchgang")
RETAINED = ("retained", "mass", "weight", "oversize", "rückstand", "masse", "siebrückstand")
SIEVES = "opening (mm);retained (g)"


def read_sieves(given: str, base: Path, key: str) -> dict[str, object]:
    """The size distribution of the sieve analysis in a CSV file: openings, with their unit, and of each the part of the
    mass that is finer (passing) or what lay on it (retained), the pan with the size of the finest granule.

    Raises SceneError, by the ``key``, for a file that cannot be read or says less.
    """
    say = f"{key} = {given!r}"
    sheet = _sheet(user_path(given, base, key), say)
    columns = {kind: [i for i, head in enumerate(sheet.heads) if head.split(" ")[0] in names]
               for kind, names in (("opening", OPENINGS), ("passing", PASSING), ("retained", RETAINED))}  # fmt: skip
    amounts = columns["passing"] + columns["retained"]
    if len(columns["opening"]) != 1 or len(amounts) != 1:
        raise SceneError(f"{say}: its heads are {', '.join(sheet.heads) or 'none'}; write {SIEVES}, or passing (%)")
    place, amount = columns["opening"][0], amounts[0]
    sheet = sheet.added_up([place], [amount])
    rows = []
    for at, cells in sheet.rows:
        parts = split_quantity(cells[place]), split_quantity(cells[amount]) if len(cells) > amount else None
        if parts[0] is None or parts[1] is None or not parts[0][1]:
            raise SceneError(f"{say}: {at}: needs an opening with its unit and a number, under heads such as {SIEVES}")
        try:
            rows.append((_in("m", cells[place]), _in("1", cells[amount]) if columns["passing"] else parts[1][0]))
        except ValueError as problem:
            raise SceneError(f"{say}: {at}: {problem}") from None
    rows.sort()
    passing = [share for _, share in rows]
    if columns["retained"]:
        total = sum(passing)
        if not rows or total <= 0.0 or min(passing) < 0.0:
            raise SceneError(f"{say}: nothing lay on any sieve")
        if rows[-1][1] > 0.0:
            raise SceneError(f"{say}: {rows[-1][1]:g} lay on the widest sieve; add one that all passes, with 0 on it")
        passing = [sum(passing[:i]) / total for i in range(len(rows) - 1)] + [1.0]
    elif any(share > 1.0 for share in passing):
        raise SceneError(f"{say}: passing beyond 1: write the head passing (%)")
    return {"distribution": "table", "diameters": [d for d, _ in rows], "passing": passing}


# -- What a user's own OpenFOAM case says of its air -------------------------------------------------------------------
NUMBER = r"[-+.\d]+(?:[eE][-+]?\d+)?"
UNIFORM = rf"uniform\s*\(\s*({NUMBER})\s+({NUMBER})\s+({NUMBER})\s*\)"


def find_case(given: str, base: Path) -> Path:
    """The case's folder, absolute; ``given`` is relative to ``base``. Raises SceneError where no case with a mesh and a
    solution is.
    """
    case = user_path(given, base, "air.case").resolve()
    boundary = case / "constant" / "polyMesh" / "boundary"
    if not any(path.exists() for path in (boundary, boundary.with_name("boundary.gz"))):
        raise SceneError(f"air.case = {given!r}: no OpenFOAM mesh (constant/polyMesh) in {case}")
    if not _solved(case):
        cure = "run its solver (and reconstructPar) first, or rename 0 to 1 if that is a solution"
        raise SceneError(f"air.case = {given!r}: no solved time in {case}; {cure}")
    return case


def _solved(case: Path) -> list[Path]:
    """The time folders that hold a velocity, the last one last, 0 left out."""
    result = [(float(p.name), p) for p in case.iterdir() if re.fullmatch(NUMBER, p.name) and p.name.count(".") <= 1]
    return [p for time, p in sorted(result) if time > 0 and any((p / file).exists() for file in ("U", "U.gz"))]


def _entries(path: Path) -> Entries:
    """What a file of the case says; nothing where there is none. Raises SceneError where it cannot be read."""
    try:
        return read_entries(path)[0] if any(item.exists() for item in (path, path.with_name(path.name + ".gz"))) else {}
    except FoamError as problem:
        raise SceneError(f"air.case: {problem}") from None


def air_of(case: Path) -> JsonTable:
    """What of ``speed`` (m/s), ``direction`` and ``nu`` (m2/s) the case says: its inlet where that is one uniform
    vertical velocity, and its constant viscosity. Streams across the channel are no inlet. Raises SceneError where its
    files cannot be read.
    """
    result: dict[str, object] = {}
    path = _solved(case)[-1] / "U"
    boundary = _entries(path).get("boundaryField")
    if not isinstance(boundary, dict):
        raise SceneError(f"air.case: {path} is cut short: it has no boundaryField; write that time anew")
    speeds = set()
    for entry in (item for item in boundary.values() if isinstance(item, dict)):
        uniform = re.fullmatch(UNIFORM, str(entry.get("value")))
        if uniform and entry.get("type") in ("fixedValue", "uniformFixedValue"):
            x, y = float(uniform[1]), float(uniform[2])
            if abs(y) > abs(x):
                speeds.add(y)
    if len(speeds) == 1:
        speed = speeds.pop()
        result = {"speed": abs(speed), "direction": "up" if speed > 0 else "down"}
    for file in (("constant", "transportProperties"), ("constant", "physicalProperties"), ("system", "parameters")):
        nu = re.fullmatch(rf"(?:nu\s+)?(?:\[[^\]]*\]\s*)?({NUMBER})", str(_entries(case.joinpath(*file)).get("nu")))
        if nu and "nu" not in result:
            result["nu"] = float(nu[1])
    return result


def is_laminar(case: Path) -> bool:
    """Whether the case's solution has no turbulence: no k beside its velocity."""
    return not any((_solved(case)[-1] / name).exists() for name in ("k", "k.gz"))
