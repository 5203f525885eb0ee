"""The form beside the drawing: every table of a scene with every key that it may have, as the schema describes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ...core.record import JsonTable
from ...laws.material import materials
from ...laws.shape import shapes
from ...scene import schema
from ...scene.schema import Node, Place, described, known_keys, named_tables

OPEN = ("force", "uncertainty")  # whose keys are the user's
# What a new table begins with; numbers are lengths, in widths of the channel
FIRST: dict[str, dict[str, object]] = {
    "body": {"shape": '"rhombus"', "width": 0.125, "slope_angle": '"45 deg"', "at": '["0 mm", "0 mm"]'},
    "bin": {"from": -0.05, "to": 0.05},
    "fraction": {"material": '"wheat"'},
    "air": {"speed": '"5 m/s"'},
    "vibration": {"frequency": '"30 Hz"', "gamma": "2.0"},
    "channel.inlet": {"side": '"left"', "position": '"0 mm"', "width": 0.05, "velocity": '"1 m/s"'},
}


def form_of(data: JsonTable) -> list[dict[str, object]]:
    """The groups of fields of a scene's ``data`` as tomlkit reads it, in the order of its tables; a table in one line
    is one field.
    """
    every = schema.scene_schema()["properties"]
    absent: JsonTable = {name: {} for name in every if name not in data and known_keys(described((name,), data))}
    groups = [group for name, value in {**data, **absent}.items() for group in _groups((name,), value, data)]
    loose = {"table": "", "about": "", "fields": [_field(("materials",), data)], "removable": False}
    return [*groups, loose]


def addable(data: JsonTable) -> list[dict[str, object]]:
    """The tables that may be added: by a name of the user's, or once."""
    places = {name: tuple(name.split(".")) for name in FIRST}
    named = {name: named_tables(place, data) for name, place in places.items()}
    about = {name: described(place, data).get("description", "") for name, place in places.items()}
    return [
        {"table": name, "named": named[name], "about": about[name]} for name in FIRST if named[name] or name not in data
    ]


def first_keys(table: str, width: float) -> dict[str, str]:
    """What a new table begins with: keys and what is typed there. ``width``: of the channel (m)."""
    first = FIRST.get(table) or FIRST.get(table.rpartition(".")[0], {})
    return {
        key: f'"{1000 * value * width:g} mm"' if isinstance(value, float) else str(value)
        for key, value in first.items()
    }


def _groups(place: Place, value: Any, data: JsonTable) -> Iterator[dict[str, object]]:
    """A table's group and, below it, those of the tables within it."""
    if not isinstance(value, Mapping):
        return
    from tomlkit.items import InlineTable

    inner = [key for key, part in value.items() if isinstance(part, Mapping) and not isinstance(part, InlineTable)]
    keys = known_keys(described(place, data))
    if keys or place[0] in OPEN:
        shown = [key for key in dict.fromkeys([*value, *keys]) if key not in inner]
        yield {
            "table": ".".join(map(str, place)),
            "about": described(place, data).get("description", ""),
            "fields": [_field((*place, key), data) for key in shown if not named_tables((*place, key), data)],
            "removable": place not in (("channel",), ("feed",)) and place[0] in data,
        }
    for key in inner:
        yield from _groups((*place, key), value[key], data)


def _field(place: Place, data: JsonTable) -> dict[str, object]:
    """One key: what is typed, its unit, what it means and what it may be."""
    node = described(place, data)
    unit, example = schema.unit_and_example(node) or ("", "")
    return {
        "key": ".".join(map(str, place)),
        "label": str(place[-1]),
        "value": _typed(place, data),
        "about": node.get("description", ""),
        "hint": example or schema.allowed_range(node, unit) or _default(node),
        "choices": _choices(place, node, data),
    }


def _default(node: Node) -> str:
    default = node.get("default")
    return "" if default is None or isinstance(default, dict | list) else f"{default}"


def _typed(place: Place, data: JsonTable) -> str | None:
    """A value as it is written, a text without its quotes; None where the key is not given."""
    here: Any = data
    for part in place:
        if not isinstance(here, Mapping) or part not in here:
            return None
        here = here[part]
    if isinstance(here, str):
        return str(here)
    if hasattr(here, "as_string"):
        return str(here.as_string()).strip()
    return str(here).lower() if isinstance(here, bool) else str(here)


def _choices(place: Place, node: Node, data: JsonTable) -> list[str]:
    """What a value is chosen from, where that is a list."""
    match place:
        case ("body", _, "shape"):
            return list(shapes)
        case ("fraction", _, "material"):
            return list(materials)
        case ("fraction", _, "target"):
            return list(data.get("bin", {}))
    choices: list[str] = []
    for kind in (node, *node.get("anyOf", ())):
        choices += map(str, kind.get("enum", ()))
        if kind.get("type") == "boolean":
            choices += ["true", "false"]
    return choices
