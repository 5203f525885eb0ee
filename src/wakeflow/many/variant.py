"""The scenes of a sweep: one base changed along axes, a sweep file, or scenes of the caller's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from numbers import Integral
from pathlib import Path

from ..core.errors import SceneError
from ..core.files import path_of, read_toml, user_path
from ..core.record import JsonMapping, JsonTable
from ..core.registry import did_you_mean
from ..planning.stage_cache import Listener, null_listener
from ..scene import Scene
from ..scene.changes import differing, flat, folder_name, stem_name
from ..scene.overrides import changes_of
from ..scene.schema import refuse_unknown
from .axis import DIGITS, Axis, axes_of, axis_of_text, designs


# -- Files that ask for many scenes ------------------------------------------------------------------------------------
@dataclass(frozen=True)
class TaskFile:
    """The ``table`` called ``kind`` of the file at ``path``, which holds nothing beside it."""

    path: Path
    kind: str
    table: JsonMapping

    @classmethod
    @contextmanager
    def open(cls, path: Path | str, kind: str, known: Sequence[str]) -> Iterator[TaskFile]:
        """The file's table, whose keys are all ``known``. Raises SceneError where it is none; what is raised within
        names the file.
        """
        path = path_of(path, f"{kind} file")
        whole = _read(path)
        if not isinstance(whole.get(kind), Mapping):
            raise SceneError(f"{path}: has no [{kind}] table, so it is no {kind} file")
        if len(whole) > 1:
            raise SceneError(f"{path}: a {kind} file holds [{kind}] only; keys of the scene belong into [{kind}.set]")
        try:
            if unknown := [key for key in whole[kind] if key not in known]:
                raise SceneError(
                    f"{kind}.{unknown[0]}: unknown key{did_you_mean(unknown[0], list(known))} "
                    f"(known: {', '.join(known)})"
                )
            yield cls(path, kind, whole[kind])
        except SceneError as problem:
            raise SceneError(f"{path}: {problem}") from None

    @property
    def scene(self) -> Path:
        """The scene file to change. Raises SceneError where none is named."""
        name = self.table.get("scene")
        if not isinstance(name, str):
            raise SceneError(f"{self.kind}.scene is missing: name the scene file to change, relative to this one")
        return user_path(name, self.path.parent, f"{self.kind}.scene")

    def inside(self, key: str) -> JsonMapping:
        """The table ``key`` of the table; empty where there is none. Raises SceneError where it is something else."""
        table = self.table.get(key, {})
        if not isinstance(table, Mapping):
            raise SceneError(f"{self.kind}.{key} = {table!r}: must be a table")
        return table

    def whole_number(self, key: str, least: int = 0) -> int:
        """The number ``key``; 0 where none is given. Raises SceneError where it is not whole or below ``least``."""
        number = self.table.get(key, 0)
        if key in self.table and (not isinstance(number, int) or isinstance(number, bool) or number < least):
            raise SceneError(f"{self.kind}.{key} = {number!r}: give a whole number of at least {least}")
        return int(number)


def holds_task(path: Path | str, kind: str) -> bool:
    """Whether a TOML file has a table ``kind``; a scene has not. Raises SceneError where it is no TOML file."""
    return kind in _read(Path(path))


def _read(path: Path) -> JsonMapping:
    try:
        return read_toml(path)
    except (FileNotFoundError, IsADirectoryError):
        raise SceneError(f"no file {str(path)!r}") from None


# -- The scenes of a sweep ---------------------------------------------------------------------------------------------
KNOWN = ("scene", "design", "count", "seed", "over", "set")
SCENES_PER_LINE = 100  # scenes between words about how many are read or planned
UNCHANGED = "base"  # name of a scene in which nothing was changed


@dataclass(frozen=True)
class Variant:
    """One scene of a sweep: its ``name``, which its folder has too; ``inputs``, dotted keys with their values in SI.

    Where the scene cannot be made ``scene`` is None and ``problem`` says why.
    """

    name: str
    inputs: JsonMapping
    scene: Scene | None
    problem: str = ""

    @classmethod
    def of(cls, make: Callable[[], Scene], inputs: JsonMapping) -> Variant:
        """A variant without a name, of the scene that ``make`` makes, or with why it cannot be made."""
        try:
            return cls("", inputs, make())
        except SceneError as problem:
            return cls("", inputs, None, str(problem))

    def __repr__(self) -> str:
        """Name of the variant, what it changes where the name does not say that, and why it cannot be made."""
        inputs = ", ".join(f"{key} = {value!r}" for key, value in self.inputs.items())
        named = self.name.startswith(folder_name(self.inputs))
        rest = self.problem if self.scene is None else "" if named else inputs
        return f"<Variant {': '.join(filter(None, (self.name, rest)))}>"


def variants(
    scene: Scene | Path | str,
    over: Mapping[str, object] | Sequence[str],
    *,
    design: str = "grid",
    count: int | None = None,
    seed: int = 0,
    fixed: Mapping[str, object] | None = None,
    listener: Listener | None = None,
) -> list[Variant]:
    """``scene``, or the one in a file, changed along axes.

    ``over``: dotted keys, each a list of values or a range {"from": ..., "to": ..., "count": ...}; or texts as of
    ``--set``. ``design``: grid, list, one-at-a-time, or latin-hypercube and sobol with ``count`` scenes and a ``seed``.
    ``fixed``: dotted keys that are the same in all. ``listener`` hears how many are read. A variant that
    is no valid scene says so itself. Raises SceneError where the axes or the design are wrong.
    """
    if not isinstance(over, Mapping | Sequence) or not all(isinstance(text, str) for text in over):
        raise SceneError(f"over = {over!r}: give keys and their values, {{'air.speed': ['5 m/s', '6 m/s']}}")
    axes = axes_of(over, "sweep") if isinstance(over, Mapping) else [axis_of_text(text) for text in over]
    for name, number, least in (("seed", seed, 0), ("count", 1 if count is None else count, 1)):
        if isinstance(number, bool) or not isinstance(number, Integral) or number < least:
            raise SceneError(f"{name} = {number!r}: give a whole number of at least {least}")
    if fixed is not None and not isinstance(fixed, Mapping):
        raise SceneError(f"fixed = {fixed!r}: name each key and its value, {{'air.speed': '7 m/s'}}")
    if not axes:
        raise SceneError("a sweep needs a key to change: --set KEY=a,b,c, or [sweep.over] in a file")
    keys = [key for axis in axes for key in axis.keys]
    if twice := {key for key in keys if keys.count(key) > 1}:
        raise SceneError(f"{twice.pop()} is swept twice; give all its values at once")
    base = scene if isinstance(scene, Scene) else path_of(scene, "scene")
    alone = [axis.changes(axis.values[0]) for axis in axes if len(axis.values) == 1]
    before = {**(fixed or {}), **{key: value for part in alone for key, value in part.items()}}
    axes = [axis for axis in axes if len(axis.values) > 1]
    load: Callable[[JsonTable], Scene] = base.replace if isinstance(base, Scene) else lambda c: Scene.load(base, c)
    tables = load(before).tables()  # a base that is wrong is the caller's mistake, not a variant's; so is a wrong key
    for key in keys:
        refuse_unknown(key, tables, key)
    rows, made = designs[design](axes, count or 0, seed), []
    for number, changes in enumerate(rows, 1):
        if number % SCENES_PER_LINE == 0 and listener is not None:
            listener("sweep", f"reading scene {number} of {len(rows)}")
        made.append(_variant(load, before, changes, axes))
    return named(made)


def read_scenes(
    file: Path, settings: Sequence[str], design: str, count: int | None, seed: int, listener: Listener = null_listener
) -> tuple[list[Variant], str]:
    """The scenes of a sweep file, or of a scene file changed by ``settings``; and a name for the folder: the file's,
    with the keys of the settings. Of a sweep file settings are values that all scenes have.

    Raises SceneError as :func:`variants` and :func:`read_sweep_file` do.
    """
    keys = [axis_of_text(text).key for text in settings]
    if holds_task(file, "sweep"):
        made = read_sweep_file(file, changes_of(settings), listener)
    else:
        made = _distinct(variants(file, settings, design=design, count=count, seed=seed, listener=listener))
    return made, "+".join((stem_name(file.stem), *keys))


def _variant(
    load: Callable[[JsonTable], Scene], fixed: Mapping[str, object], changes: Mapping[str, object],
    axes: Sequence[Axis],
) -> Variant:  # fmt: skip
    made = Variant.of(lambda: load({**fixed, **changes}), changes)
    if made.scene is None:
        return made
    set_now = flat(made.scene.tables())
    inputs: dict[str, object] = {}
    for varied in (key for axis in axes for key in axis.keys):
        # a value that is a table, such as a law of restitution, is more than one input; one that is not set is none
        inside = {key: value for key, value in set_now.items() if f"{key}.".startswith(f"{varied}.")}
        if "*" in varied:  # all that it represents have one value
            values = [value for key, value in set_now.items() if fnmatchcase(key, varied)]
            inside = {varied: values[0]} if values else {}
        inputs |= inside or ({varied: changes[varied]} if varied in changes else {})
    return replace(made, inputs=inputs)


def _distinct(every: Iterable[Variant]) -> list[Variant]:
    """The variants without those whose scene is an earlier one's too, as of 80 mm and 0.08 m."""
    first: dict[str, Variant] = {}
    for variant in every:
        whole = variant.inputs if variant.scene is None else flat(variant.scene.tables())
        rounded = {key: float(f"{v:.{DIGITS}g}") if isinstance(v, float) else v for key, v in whole.items()}
        first.setdefault(repr(rounded), variant)
    return list(first.values())


def named(every: Sequence[Variant]) -> list[Variant]:
    """Name the variants, those without a name after their inputs; no name is taken twice."""
    result: list[Variant] = []
    taken: set[str] = set()
    for variant in every:
        wanted = variant.name or folder_name(variant.inputs) or UNCHANGED
        name, number = wanted, 1
        while name in taken:
            number += 1
            name = f"{wanted}-{number}"
        taken.add(name)
        result.append(replace(variant, name=name))
    return result


def of_scenes(scenes: Iterable[Scene | Path | str | Variant] | Mapping[str, Scene | Path | str]) -> list[Variant]:
    """Variants of scenes, or scene files, that are there already: what they differ in is their inputs. Raises
    SceneError without any.
    """
    if isinstance(scenes, Mapping):
        names, members = list(scenes), [Scene.of(scene) for scene in scenes.values()]
    else:
        if isinstance(scenes, Scene) or not isinstance(scenes, Iterable):
            raise SceneError("a sweep takes a list of scenes, what wf.variants made, or the path of a sweep file")
        given = list(scenes)
        made = [scene for scene in given if isinstance(scene, Variant)]
        if made and len(made) == len(given):
            return named(made)
        if made:
            raise SceneError("a sweep takes scenes, or what wf.variants made, not both together")
        names = [stem_name(Path(scene).stem) if isinstance(scene, Path | str) else "" for scene in given]
        members = [Scene.of(scene) for scene in given if not isinstance(scene, Variant)]
    if not members:
        raise SceneError("a sweep needs at least one scene")
    columns = differing(members)
    rows = [{key: values[place] for key, values in columns.items()} for place in range(len(members))]
    return named([Variant(*row) for row in zip(names, rows, members, strict=True)])


def read_sweep_file(
    path: Path | str, fixed: Mapping[str, object] = {}, listener: Listener = null_listener
) -> list[Variant]:
    """The scenes of a sweep file: [sweep] with scene (a path relative to the file), design, count, seed, and the tables
    [sweep.over] of keys to change and [sweep.set] of keys that are the same in all; ``fixed`` overrides the latter.

    Raises SceneError where the file is no sweep.
    """
    with TaskFile.open(path, "sweep", KNOWN) as file:
        made = variants(
            file.scene, file.inside("over"), design=file.table.get("design", "grid"),
            count=file.whole_number("count", least=1) or None, seed=file.whole_number("seed"),
            fixed={**flat(file.inside("set")), **fixed}, listener=listener,
        )  # fmt: skip
        return _distinct(made)
