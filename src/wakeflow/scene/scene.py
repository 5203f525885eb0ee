"""The scene: what is asked. Its tables together, read from TOML, changed, saved.

Origin at the first body's centre (without one on the channel's axis, at any level), y up. Numbers are SI; a string with
a unit ("50 mm", "60 deg", "30 Hz") is converted.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from inspect import Parameter, Signature
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ..core.errors import LONGEST, SceneError
from ..core.files import atomic_write, check_tables, path_of, read_toml
from ..core.quantities import say, speaking
from ..core.record import JsonTable
from .bins import SideBin
from .checks import CHECKS, OVER_THE_TOP
from .measured import trays_in
from .messages import EVERYWHERE, doubts, explain, units_in, with_units
from .overrides import changed
from .scene_tables import SceneTables
from .schema import Place
from .table import without_none
from .uncertainty import with_uncertainty_table
from .user_files import with_own_files, with_own_materials

Array = NDArray[np.float64]
MOST = 40  # mistakes of a scene that are told


class Scene(SceneTables):
    """Everything that is asked, in SI units. Frozen: ``replace`` gives a changed copy."""

    def __repr__(self) -> str:
        """What is in the channel, the air, what is fed, and into how many bins; all of it: ``tables``."""
        bodies = f"bodies {', '.join(self.body)}" if self.body else "no body"
        air = "no air" if self.air is None else f"air {self.air.blows}"
        count = f"{len(self.bin)} bin{'s' if len(self.bin) != 1 else ''}"
        return f"<Scene: {bodies}; {air}; {self._fed_by}; fractions {', '.join(self.fraction)}; {count}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """The scene in a line, and as the file that ``save`` writes, as a notebook shows it."""
        line = f"<p>{escape(repr(self))}</p>"
        return f"{line}<details><summary>as a file</summary><pre>{escape(self.as_toml())}</pre></details>"

    @property
    def _fed_by(self) -> str:
        """Where granules come from and how many, in words."""
        rate = f" {say(self.feed.rate, 'kg/s', 3)}" if self.feed.rate else ""
        return f"feed{rate} from a funnel" if self.funnel is not None else f"feed{rate or ' without a rate'}"

    @classmethod
    def parse(
        cls,
        data: Mapping[str, object],
        name: str = "scene",
        base: Path | None = None,
        doubted: Iterable[Place] = (),
    ) -> Scene:
        """Validate plain tables; paths of the user's files are relative to the folder ``base`` (default: the current
        one). Lengths in the places ``doubted`` that are far off the scene's scale need a unit.

        Raises SceneError, one line, with every mistake in its ``mistakes``: field, value and what is allowed.
        """
        if not isinstance(data, Mapping):
            raise SceneError(f"{name}: needs tables, not {type(data).__name__}")
        check_tables(data, name)
        folder, lengths = base or Path(), doubts(data, doubted)
        mistakes = list(lengths.values())
        try:
            whole = with_own_files(with_uncertainty_table(with_own_materials(data, folder)), folder)
            whole = without_none(trays_in(whole, folder))
        except SceneError as problem:
            raise _refused(name, [*mistakes, str(problem)]) from None
        with speaking(units_in(whole)):
            try:
                scene = cls.model_validate(whole)
            except ValidationError as problem:
                wrong = [item for item in explain(problem, whole) if item.partition(" ")[0] not in lengths]
                raise _refused(name, [*mistakes, *wrong]) from None
            if not mistakes:  # else what does not fit may follow from a unit
                mistakes += [message for check in CHECKS for message in check(scene)]
        if mistakes:
            raise _refused(name, mistakes)
        return scene

    @classmethod
    def of(cls, scene: Scene | Path | str) -> Scene:
        """The scene itself, or that of a scene file. Raises SceneError as :meth:`load`, and for anything else."""
        if isinstance(scene, Scene):
            return scene
        if isinstance(scene, Path | str):
            return cls.load(scene)
        raise SceneError(f"needs a Scene or the path of a scene file, not {type(scene).__name__}; see Scene.parse")

    @classmethod
    def load(cls, path: Path | str, changes: Mapping[str, object] | None = None) -> Scene:
        """Read a scene file, with ``changes`` (dotted key to value) applied before validation.

        Raises SceneError as :meth:`parse` does, and where a length without a unit is far off the scene's scale.
        """
        path = path_of(path, "scene file")
        return cls.parse(changed(_read(path), changes or {}, path.name), path.name, path.parent, EVERYWHERE)

    def replace(self, changes: Mapping[str, object]) -> Scene:
        """A copy with dotted keys changed, validated anew: ``{"fraction.chaff.restitution": 0.2}``; a star represents
        every table there is: ``{"fraction.*.impact": "paper"}``.

        Raises SceneError as :meth:`load` does, doubting no other lengths than the changed ones.
        """
        return self.parse(changed(self.tables(), changes), doubted=[tuple(key.split(".")) for key in changes])

    def fed(self, rate: float | None = None) -> Scene:
        """The scene with the funnel's ``rate`` (kg/s) as the rate of its feed; Beverloo's estimate if ``rate`` is None.
        Unchanged where the feed has a rate of its own or there is no funnel.
        """
        if self.funnel is None or self.feed.rate:
            return self
        result = self.funnel.expected_rate if rate is None else rate
        return self.model_copy(update={"feed": self.feed.model_copy(update={"rate": result})})

    def without_air(self) -> Scene:
        """The scene in a vacuum; itself where it has no air."""
        return self if self.air is None else self.model_copy(update={"air": None})

    def with_top(self) -> Scene:
        """The scene with a bin over the whole top where the air blows up and no bin lies there: what the air carries
        out is an answer, not lost. Itself otherwise, and where another bin has that name.
        """
        upward = self.air is not None and self.air.rises
        if not upward or OVER_THE_TOP in self.bin or self.on_sides("top"):
            return self
        half = self.channel.width / 2
        top = SideBin(on="top", start=-half, to=half)
        return self.model_copy(update={"bin": {**self.bin, OVER_THE_TOP: top}})

    def tables(self) -> JsonTable:
        """The scene as plain tables, only what was set, in SI numbers: what ``save`` writes and keys are made of."""
        return without_none(json.loads(self.model_dump_json(exclude_unset=True, exclude_none=True, by_alias=True)))

    def save(self, path: Path | str) -> None:
        """Write the scene as TOML in SI numbers; loading it gives an equal scene."""
        with atomic_write(path_of(path, "scene file")) as stream:
            stream.write(self.as_toml())

    def as_toml(self) -> str:
        """The scene as the text of a file, in SI numbers: what ``save`` writes."""
        import tomlkit

        return tomlkit.dumps(with_units(self.tables()))


# That of pydantic shows every validator inside, two screens long; what a scene may hold is in docs/scenes.md.
Scene.__signature__ = Signature([Parameter("tables", Parameter.VAR_KEYWORD)])


def _refused(name: str, mistakes: Sequence[str]) -> SceneError:
    """The error of a scene called ``name`` with all these mistakes: those that a line has room for, the first whole,
    and how many more there are.
    """
    room, shown = LONGEST - 60, list(mistakes[:1])
    for item in mistakes[1:]:
        if sum(map(len, shown)) + len(item) > room:
            break
        shown.append(item)
    more = f"; and {len(mistakes) - len(shown)} more" if len(mistakes) > len(shown) else ""
    every = [*mistakes[:MOST], *([f"and {len(mistakes) - MOST} more"] if len(mistakes) > MOST else [])]
    return SceneError(f"{name}: {'; '.join(shown)}{more}", [f"{name}: {item}" for item in every])


def units_written(path: Path | str) -> dict[str, str]:
    """The unit that a scene file uses most for each unit of the SI: {"m": "mm"}. Raises SceneError as Scene.load."""
    return units_in(_read(Path(path)))


def _read(path: Path) -> JsonTable:
    """The tables of a scene file, as they are written. Raises SceneError where it is none."""
    try:
        return read_toml(path)
    except FileNotFoundError:
        if path.suffix != ".toml" and (meant := path.with_name(f"{path.name}.toml")).is_file():
            raise SceneError(f"no scene file {str(path)!r}; did you mean {str(meant)!r}?") from None
        make = f"wakeflow new rhombus {shlex.quote(str(path if path.suffix else path.with_suffix('.toml')))}"
        raise SceneError(f"no scene file {str(path)!r}; make one with: {make}") from None
    except IsADirectoryError:
        raise SceneError(f"{path} is a folder; name a scene file") from None
