"""Changes of a scene that are given as text: ``--set KEY=VALUE`` and ``--force TERM=on``."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import Any

from ..core.errors import SceneError

__all__ = ["changes_of", "switches_of"]


def changes_of(settings: Sequence[str]) -> dict[str, Any]:
    """Dotted keys of a scene and their new values, from texts KEY=VALUE. Raises SceneError for any other text."""
    return {key: _value(value) for key, value in (_split(text, "--set") for text in settings)}


def switches_of(forced: Sequence[str]) -> dict[str, bool]:
    """Terms that are switched on or off, from texts TERM=on and TERM=off. Raises SceneError for any other text."""
    switches = {}
    for term, state in (_split(text, "--force") for text in forced):
        if state not in ("on", "off"):
            raise SceneError(f"--force {term}={state}: write on or off")
        switches[term] = state == "on"
    return switches


def _split(text: str, option: str) -> tuple[str, str]:
    key, sign, value = text.partition("=")
    if not sign or not key:
        raise SceneError(f"{option} {text!r}: write it as KEY=VALUE")
    return key, value


def _value(text: str) -> Any:
    """A TOML value where the text is one (number, list, true, quoted string), else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
