"""The scene file under work: its text with its comments, changed key by key or as a whole, undone, saved."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import SceneError
from ...core.files import atomic_write, read_whole, toml_of
from ...core.lazy import cached_property
from ...core.record import JsonTable
from ...scene import Scene
from ...scene.messages import EVERYWHERE, units_in

if TYPE_CHECKING:
    from tomlkit import TOMLDocument
    from tomlkit.items import Item

DEEPEST = 500  # changes that can be undone
LARGEST = 1_000_000  # letters of a scene
NO_FILE = Path()


@dataclass(frozen=True)
class Look:
    """What a text says: its tables where it is ``toml``, the scene where that is right, else what is wrong, a line
    each.
    """

    data: JsonTable
    scene: Scene | None
    mistake: str = ""
    toml: bool = True

    @property
    def units(self) -> dict[str, str]:
        """The units that it is written in."""
        return units_in(self.data)


def as_item(text: str) -> Item:
    """What a person types as a value: TOML where it is, as on the command line, else a text."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        return tomlkit.value(text.strip())
    except (TOMLKitError, ValueError):
        return tomlkit.string(text.strip())


@dataclass
class SceneDocument:
    """A scene's ``text``, the file that it is ``saved`` in, NO_FILE while it has none, and what paths in it start
    from.
    """

    text: str
    path: Path = NO_FILE
    base: Path = field(default_factory=Path)
    name: str = "scene"
    version: int = 1
    saved: str = ""  # the text as it is on the disk
    conflict: bool = False  # the file has changed on the disk, and so has the text here
    gesture: str = ""  # what made the last change, where that has a name
    _before: list[str] = field(default_factory=list)
    _after: list[str] = field(default_factory=list)

    @classmethod
    def load(cls, path: Path) -> SceneDocument:
        """The scene of a file, right or wrong. Raises SceneError where it cannot be read as text."""
        text = _read(path)
        return cls(text, path, path.parent, path.stem, saved=text)

    @property
    def changed(self) -> bool:
        """Whether the text differs from what is on the disk."""
        return self.text != self.saved

    @cached_property
    def look(self) -> Look:
        """What the text says now."""
        return _look(self.text, f"{self.name}.toml" if self.path == NO_FILE else self.path.name, self.base)

    # -- changes -------------------------------------------------------------------------------------------------------
    def write(self, text: str, gesture: str = "") -> None:
        """Replace the text; changes of one ``gesture`` are undone together. Raises SceneError for one too long."""
        if len(text) > LARGEST:
            raise SceneError(f"a scene of {len(text)} letters: at most {LARGEST}")
        text = text.replace("\r\n", "\n")
        if text == self.text:
            return
        if not gesture or gesture != self.gesture:
            self._before = [*self._before[-DEEPEST:], self.text]
        self._after, self.gesture = [], gesture
        self._become(text)

    def set(self, changes: Mapping[str, str | None], gesture: str = "") -> None:
        """Set dotted keys to what is typed, None: take them out; comments stay. Raises SceneError where the text is no
        TOML, and for a key within a value.
        """
        import tomlkit

        document = self._document()
        for key, typed in changes.items():
            _set(document, key, None if typed is None else as_item(typed))
        self.write(tomlkit.dumps(document).rstrip("\n") + "\n", gesture)

    def undo(self) -> None:
        """Take back the last change."""
        if self._before:
            self._after.append(self.text)
            self._become(self._before.pop())
            self.gesture = ""

    def redo(self) -> None:
        """Make the last change again that was taken back."""
        if self._after:
            self._before.append(self.text)
            self._become(self._after.pop())
            self.gesture = ""

    @property
    def steps(self) -> tuple[int, int]:
        """How many changes can be undone, and made again."""
        return len(self._before), len(self._after)

    def _become(self, text: str) -> None:
        self.text, self.version = text, self.version + 1
        vars(self).pop("look", None)

    def _document(self) -> TOMLDocument:
        import tomlkit
        from tomlkit.exceptions import TOMLKitError

        try:
            return tomlkit.parse(self.text)
        except TOMLKitError as problem:
            raise SceneError(f"the text is no valid TOML, mend it first: {problem}") from None

    # -- the file ------------------------------------------------------------------------------------------------------
    def save(self, path: Path = NO_FILE) -> None:
        """Write the text to its file, or to a new one. Raises SceneError where there is no name, where the file was
        changed by someone else, and where a new name is taken.
        """
        target = self.path if path == NO_FILE else path
        if target == NO_FILE:
            raise SceneError("this scene has no file yet: give a name")
        if target != self.path and os.path.lexists(target):
            raise SceneError(f"{target} exists; choose another name")
        if target == self.path and target.exists():
            _read(target)  # what is not read is not replaced
            self.compare_with_disk()
            if self.conflict:
                raise SceneError(f"{target} was changed on the disk; choose which of the two texts stays")
        with atomic_write(target.resolve()) as stream:
            if target.exists():
                os.fchmod(stream.fileno(), target.stat().st_mode & 0o7777)
            stream.write(self.text)
        self.path, self.base, self.name = target, target.parent, target.stem
        self.saved, self.version = self.text, self.version + 1

    def compare_with_disk(self) -> bool:
        """Take in a file that another program has changed, as a change that can be undone; where the text here was
        changed too, only note it. Returns whether anything is new.
        """
        if self.path == NO_FILE:
            return False
        if not self.path.exists():  # saving makes it anew
            ended, self.conflict = self.conflict, False
            return ended
        try:
            there = _read(self.path)
        except SceneError:
            return False  # half written
        if there in (self.saved, self.text):
            mended, self.conflict = self.conflict or there != self.saved, False
            self.saved = there
            return mended
        if self.changed:
            news, self.conflict = not self.conflict, True
            return news
        self.saved = there
        self.write(there)
        return True

    def settle(self, *, keep: bool) -> None:
        """End a conflict: ``keep`` the text here, to be saved over the file's, or take that of the file."""
        if self.path == NO_FILE or not self.conflict:
            return
        self.saved, self.conflict = _read(self.path), False
        self.version += 1
        if not keep:
            self.write(self.saved)


def merged(base: str, mine: str, theirs: str) -> str | None:
    """The text with both changes of ``base``; None where they are of the same or of neighbouring lines."""
    if base in (mine, theirs):
        return theirs if base == mine else mine
    start, my_lines, their_lines = (text.splitlines(keepends=True) for text in (base, mine, theirs))
    changes = [
        (low, high, made[a:b])
        for made in (my_lines, their_lines)
        for kind, low, high, a, b in SequenceMatcher(None, start, made, autojunk=False).get_opcodes()
        if kind != "equal"
    ]
    changes.sort(key=lambda change: change[:2])
    if any(after[0] <= before[1] for before, after in pairwise(changes)):
        return theirs if mine == theirs else None
    for low, high, lines in reversed(changes):
        start[low:high] = lines
    return "".join(start)


def _read(path: Path) -> str:
    try:
        text = read_whole(path).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError:
        raise SceneError(f"{path}: not UTF-8; save it as UTF-8 in your editor") from None
    except OSError as problem:
        raise SceneError(f"{path}: {problem.strerror}") from None
    if len(text) > LARGEST:
        raise SceneError(f"{path}: a scene of {len(text)} letters: at most {LARGEST}")
    return text


def _look(text: str, name: str, base: Path) -> Look:
    """Look at a text as :meth:`Scene.load` reads a file."""
    try:
        data = toml_of(text, name)
    except SceneError as problem:
        return Look({}, None, str(problem), toml=False)
    try:
        return Look(data, Scene.parse(data, name, base, EVERYWHERE))
    except SceneError as problem:
        return Look(data, None, "\n".join(problem.mistakes) or str(problem))


def _set(document: Any, key: str, item: Item | None) -> None:
    """Set a dotted key in a document; tables on the way are made, one that becomes empty goes."""
    import tomlkit

    *way, last = key.split(".")
    above, node = [], document
    for part in way:
        if part not in node:
            if item is None:
                return
            node[part] = tomlkit.table(is_super_table=part != way[-1])
            if part == way[-1]:
                node[part].add(tomlkit.nl())
        above.append((node, part))
        node = node[part]
        if not isinstance(node, Mapping):
            raise SceneError(f"{key}: {part} is a value, not a table")
    if item is not None:
        _put(node, last, item)
        return
    if last in node:
        del node[last]
    for parent, part in reversed(above):
        if not len(parent[part]) and parent is not document:
            del parent[part]


def _put(table: Any, key: str, item: Item) -> None:
    """A known key keeps its comment, in its column; a new one goes after the last of its table, before the blank line
    that ends it.
    """
    from tomlkit.items import Item, Table, Whitespace

    if key in table or not isinstance(table, Table):
        before = table.get(key)
        if isinstance(before, Item) and before.trivia.comment:  # stays in its column
            room = len(before.trivia.comment_ws) + len(before.as_string()) - len(item.as_string())
            item.trivia.comment_ws = " " * max(1, room)
        table[key] = item
        return
    body, tail = table.value.body, []
    while body and body[-1][0] is None and isinstance(body[-1][1], Whitespace):
        tail.append(body.pop())
    table.append(key, item)
    body.extend(reversed(tail))
