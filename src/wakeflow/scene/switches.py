"""Terms that are switched by hand: by a scene's [force], and by ``force`` in Python."""

from __future__ import annotations

from collections.abc import Mapping

from ..core.errors import SceneError

__all__ = ["ON_OFF", "States", "states_of", "switched"]

States = Mapping[str, bool | str | Mapping[str, bool | str]]  # of terms: True or "on", False or "off"
ON_OFF = "on", "off"


def switched(force: States | None) -> dict[str, bool]:
    """Terms that are switched from Python, each True, False, "on" or "off"; empty without any.

    Raises SceneError for anything else: another text would count as true.
    """
    if force is None:
        return {}
    if not isinstance(force, Mapping):
        raise SceneError(f"force = {force!r}: name each term and its state, {{'lift': 'off'}}")
    try:
        return states_of(force)
    except ValueError as problem:
        raise SceneError(f"force: {problem}") from None


def states_of(table: States) -> dict[str, bool]:
    """{"chaff.lift": True} from {chaff: {lift: "on"}}, as TOML reads ``chaff.lift = "on"``. Raises ValueError for a
    state that is none.
    """
    found: dict[str, bool] = {}
    for key, state in table.items():
        if isinstance(state, Mapping):
            found.update({f"{key}.{term}": on for term, on in states_of(state).items()})
        elif isinstance(state, bool) or (isinstance(state, str) and state in ON_OFF):
            found[str(key)] = state is True or state == "on"
        else:
            raise ValueError(f"{key} = {state!r}: write on or off")
    return found
