"""Materials of the user's own: a TOML file beside the scene, written as laws/materials.toml is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..core.errors import SceneError
from ..core.toml import read_toml
from ..laws.material import Material, materials, read_material

__all__ = ["read_materials", "with_own_materials"]

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


def with_own_materials(data: Mapping[str, Any], base: Path, name: str) -> Mapping[str, Any]:
    """The tables with what the file ``materials`` says in place of its name, so that results tell what was computed: a
    fraction of such a material has its values, but for those that it gives itself.

    Raises SceneError as :func:`read_materials` does.
    """
    file = data.get("materials")
    if not isinstance(file, str):
        return data
    try:
        known = read_materials(base / file)
    except SceneError as problem:
        raise SceneError(f"{name}: {problem}") from None
    fractions = {
        which: _as_fraction(known[table["material"]], table)
        if isinstance(table, Mapping) and table.get("material") in known
        else table
        for which, table in dict(data.get("fraction", {})).items()
    }
    return {**{key: table for key, table in data.items() if key != "materials"}, "fraction": fractions}


def _as_fraction(material: Material, table: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a fraction of a ``material``, those in its own ``table`` first."""
    values: dict[str, Any] = {
        "size": material.diameter, "density": material.density, "impact": material.impact,
        "restitution": _spread(material.restitution, material.restitution_std),
        "friction": _spread(material.friction, material.friction_std),
    }  # fmt: skip
    if material.terminal_velocity is not None and "sphericity" not in table:
        values["terminal_velocity"] = _spread(material.terminal_velocity, material.terminal_velocity_std)
    values |= {key: value for key in SHAPED if (value := getattr(material, key))}
    if "inertia" in table:
        del values["impact"]
    return {**values, **{key: value for key, value in table.items() if key != "material"}}


def _spread(mean: Any, std: float) -> Any:
    """A number of all granules, or how it spreads over them."""
    return {"distribution": "normal", "mean": mean, "std": std} if std else mean
