"""What differs between scenes, names of folders made of it, and scene files to start from."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from ..core.errors import SceneError
from ..core.files import atomic_write, scene_templates
from ..core.registry import did_you_mean
from .scene import Scene
from .table import flat as flat  # handed on

# -- What differs between scenes ---------------------------------------------------------------------------------------
MAX_NAME = 100  # letters of a folder's name: file systems take 255 bytes, people fewer
PARTS = "+"  # between the changes in a name


def differing(scenes: Sequence[Scene]) -> dict[str, list[object]]:
    """The dotted keys, defaults counted, in which scenes differ: for each the value in every scene, SI; None where a
    scene has no such key.
    """
    every = [flat(scene.model_dump(mode="json", by_alias=True)) for scene in scenes]
    keys = dict.fromkeys(key for item in every for key in item)
    columns = {key: [item.get(key) for item in every] for key in keys}
    return {key: values for key, values in columns.items() if any(value != values[0] for value in values)}


def folder_name(changes: Mapping[str, object]) -> str:
    """A name for the folder of what was changed: its keys and values, safe on every file system.

    Numbers have six digits. A name that would be long ends in a fingerprint of all changes instead.

    >>> folder_name({"air.speed": 7.0, "numerics.rung": "draft"})
    'air.speed=7+numerics.rung=draft'
    """
    name = PARTS.join(f"{key}={_text(value)}" for key, value in changes.items())
    if len(name) <= MAX_NAME:
        return name
    mark = hashlib.sha256(json.dumps(dict(changes), default=str).encode()).hexdigest()[:8]
    return f"{name[: MAX_NAME - len(mark) - 1]}-{mark}"


def run_folder(stem: str, scene: Scene, changed: Iterable[str], options: Mapping[str, object]) -> str:
    """The name of a run's folder: that of its scene file, and what was ``changed`` in it, in SI, with the ``options``
    that are given; so that variants of a scene do not overwrite each other.
    """
    tables = flat(scene.tables())
    values = {key: value for key, value in tables.items() if any(f"{key}.".startswith(f"{item}.") for item in changed)}
    given = {name: value for name, value in options.items() if value is not None}
    return PARTS.join(filter(None, (stem_name(stem), folder_name({**values, **given}))))


def stem_name(stem: str) -> str:
    """The name of a file without its ending as that of a folder: one that leads nowhere else, as ".." would.

    >>> stem_name("rhombus"), stem_name("..")
    ('rhombus', 'scene')
    """
    return stem.lstrip(". ") or "scene"


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = re.sub(r"\s*%", "pct", value if isinstance(value, str) else json.dumps(value, default=str))
    return re.sub(r"[^A-Za-z0-9.,_-]+", "-", text).strip("-")


# -- Scene files to start from -----------------------------------------------------------------------------------------
def template_of(kind: str) -> Path:
    """The file of the shipped scene called ``kind``. Raises SceneError for an unknown one."""
    known = scene_templates()
    if kind not in known:
        raise SceneError(f"unknown scene {kind!r}{did_you_mean(kind, list(known))} (known: {', '.join(known)})")
    return known[kind]


def write_template(kind: str, target: Path, *, overwrite: bool = False) -> None:
    """Write the shipped scene called ``kind`` to the file ``target``, which the commands in its comments name.

    Raises SceneError for an unknown kind, and where the file exists and ``overwrite`` does not allow replacing it.
    """
    template = template_of(kind)
    if os.path.lexists(target) and not overwrite:
        raise SceneError(f"{target} exists; choose another name or add --overwrite")
    path, text = shlex.quote(str(target)), template.read_text(encoding="utf-8")
    with atomic_write(target) as stream:
        stream.write(f"# Look at it:  wakeflow plan {path}    Compute it:  wakeflow run {path}\n")
        stream.write(text.replace(f"wakeflow run cases/{kind}.toml", f"wakeflow run {path}"))


# -- What a draw changes of a scene ------------------------------------------------------------------------------------
ONE = 1.0


@dataclass(frozen=True)
class GranuleVariation:
    """What a draw changes of a fraction's granules: added to the restitution, factors on the rest. ``drag``: on the
    drag coefficient; ``size``: on the diameter; ``density``: on the density; ``inverse_inertia``: on m r^2 / I, how
    easily a blow turns it; ``spin_lift``: on the coefficient of its spin lift.
    """

    restitution: float = 0.0
    friction: float = ONE
    scatter: float = ONE
    drag: float = ONE
    size: float = ONE
    density: float = ONE
    inverse_inertia: float = ONE
    spin_lift: float = ONE


@dataclass(frozen=True)
class AirVariation:
    """What a draw changes of the air: factors on its ``speed``, on the ``energy`` of its turbulence, on the
    ``lifetime`` of the eddies; ``theta`` and ``strength`` of the wake instead of the plan's (None: the plan's).
    """

    speed: float = ONE
    energy: float = ONE
    lifetime: float = ONE
    theta: float | None = None
    strength: float | None = None


@dataclass(frozen=True)
class Variation:
    """One draw: of the granules by fraction, of the air, of the curtain (factors on its width and on the height that it
    has fallen, a shift in m).
    """

    granules: Mapping[str, GranuleVariation] = field(default_factory=dict)
    air: AirVariation = AirVariation()
    feed_width: float = ONE
    feed_shift: float = 0.0
    feed_fall: float = ONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "granules", MappingProxyType(dict(self.granules)))

    def of(self, name: str) -> GranuleVariation:
        """What changes of fraction ``name``."""
        return self.granules.get(name, GranuleVariation())

    def with_granules(self, name: str, **changes: float) -> Variation:
        """This draw with something more changed of fraction ``name``."""
        return replace(self, granules={**self.granules, name: replace(self.of(name), **changes)})

    def with_air(self, **changes: float) -> Variation:
        """This draw with something more changed of the air."""
        return replace(self, air=replace(self.air, **changes))

    def fed(self, scene: Scene) -> Scene:
        """The scene with the curtain and the air's speed of this draw."""
        feed = scene.feed
        changed = {"width": feed.width * self.feed_width, "position": feed.position + self.feed_shift}
        if feed.height:
            changed["height"] = feed.height * self.feed_fall
        if feed.speed is not None:
            changed["speed"] = feed.speed * math.sqrt(self.feed_fall)
        feed = feed.model_copy(update=changed)
        air = scene.air and scene.air.model_copy(update={"speed": scene.air.speed * self.air.speed})
        return scene.model_copy(update={"feed": feed, "air": air})


AS_GIVEN = Variation()  # the scene's own numbers
