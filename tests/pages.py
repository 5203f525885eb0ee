"""The pages of the documents for their tests: fenced blocks, commands that a page shows, and code that is tried."""

import re
import shlex
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
from cyclopts import App, CycloptsError, MissingArgumentError

import wakeflow as wf
from support import DOCS, ROOT
from wakeflow.cli import app
from wakeflow.core.registry import Registry, register_extras

PAGES = [
    *(ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY")),
    *sorted(DOCS.glob("*.md")),
]
FENCED = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"(?:^|\.venv/bin/)wakeflow (?=[a-z-])")
EXAMPLE = "example_of_a_page"  # the module that a block of Python is


class Block(NamedTuple):
    """A fenced block: its page, the heading above it, what stands behind the fence, and its text."""

    page: Path
    heading: str
    info: str
    body: str


def blocks(page: Path) -> Iterator[Block]:
    """Every fenced block of a page, in order."""
    for part in re.split(r"^#+ (?=[^\n]*\n)", f"\n{page.read_text()}", flags=re.MULTILINE):
        for info, body in FENCED.findall(part):
            yield Block(page, part.partition("\n")[0], info, body)


def spans(text: str) -> list[str]:
    """Code between backticks in the running text."""
    found = re.findall(r"`([^`]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))
    return [" ".join(span.split()) for span in found]


def shell_lines(page: Path) -> list[str]:
    """Lines of shell blocks, without comments."""
    fenced = [line for block in blocks(page) if block.info == "sh" for line in block.body.splitlines()]
    return [re.sub(r"\s+#.*|\s{3,}.*", "", line).strip() for line in fenced]


def commands_in(lines: Iterable[str]) -> list[str]:
    """Every ``wakeflow ...`` among lines, without its first word."""
    return [COMMAND.sub("", line) for line in lines if COMMAND.match(line)]


def parse_command(command: str, of: App = app) -> None:
    """Read a command line without its first word. Raises AssertionError where the program would refuse it."""
    words = shlex.split(command, comments=True)
    try:
        of.parse_args(words, exit_on_error=False, print_error=False)
    except MissingArgumentError:  # the command alone, or with one option: it is there
        of.parse_args([words[0], "--help"], exit_on_error=False, print_error=False)
    except CycloptsError as problem:
        raise AssertionError(f"{command}: {problem}") from None


@contextmanager
def tried(code: str) -> Iterator[dict[str, Any]]:
    """The names that a block of Python leaves; what it adds to registries and commands is taken out again."""
    register_extras()
    module = ModuleType(EXAMPLE)
    module.__dict__["wf"] = wf
    added: list[tuple[Registry[Any], str]] = []
    commands, add = set(app), Registry.add

    def noted(registry: Registry[Any], name: str, entry: Any) -> Any:
        if _by_the_example():
            added.append((registry, name))
        return add(registry, name, entry)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, EXAMPLE, module)  # where a scene's table looks up its annotations
        patch.setattr(Registry, "add", noted)
        try:
            exec(compile(code, "a page", "exec"), module.__dict__)
            yield module.__dict__
        finally:
            for registry, name in added:
                registry.remove(name)
            for name in set(app) - commands:
                del app[name]


def _by_the_example() -> bool:
    """Whether the example adds an entry, and not a module of the package that is imported meanwhile."""
    frame = sys._getframe(2)
    while "importlib" not in frame.f_code.co_filename:
        if frame.f_globals.get("__name__") == EXAMPLE:
            return True
        if frame.f_back is None:
            return False
        frame = frame.f_back
    return False
