"""What other programs and people call: commands, options, scene keys and public names. None may be lost.

contract.txt lists them, a line each. New ones are added by ``python tests/unit/test_contract.py``; a line goes only
together with an entry in CHANGELOG.md.
"""

import inspect
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from textwrap import fill
from typing import Any

import wakeflow

LIST = Path(__file__).with_name("contract.txt")
PAGE = Path(__file__).parents[2] / "docs" / "commands.md"
GENERATED = "<!-- written by python tests/unit/test_contract.py from here on -->\n"


def commands() -> Iterator[str]:
    """``command NAME`` and ``option NAME --option``, of every spelling that the parser takes."""
    from wakeflow.cli import app

    for name in app:
        if name.startswith("-"):
            continue
        yield f"command {name}"
        for argument in app[name].assemble_argument_collection():
            yield from (f"option {name} {spelling}" for spelling in argument.names if spelling != "*")


def scene_keys() -> Iterator[str]:
    """``key TABLE.key``; ``*`` is a name of the user's."""
    from wakeflow.scene.schema import scene_schema

    schema = scene_schema()

    def walk(node: dict[str, Any], path: tuple[str, ...], seen: tuple[str, ...]) -> Iterator[str]:
        for part in (node, *node.get("anyOf", ()), *node.get("oneOf", ())):
            reference = part.get("$ref", "").rpartition("/")[2]
            if reference and reference not in seen:
                yield from walk(schema["$defs"][reference], path, (*seen, reference))
            for key, value in part.get("properties", {}).items():
                yield "key " + ".".join((*path, key))
                yield from walk(value, (*path, key), seen)
            for value in part.get("patternProperties", {}).values():
                yield from walk(value, (*path, "*"), seen)

    yield from walk(schema, (), ())


def names() -> Iterator[str]:
    """``name wf.NAME``, its public attributes, and ``parameter wf.NAME(parameter)``."""
    for name in wakeflow.__all__:
        thing = getattr(wakeflow, name)
        yield f"name wf.{name}"
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            annotated = {key for base in thing.__mro__ for key in getattr(base, "__annotations__", {})}
            own = {key for key in annotated | set(dir(thing)) if not key.startswith(("_", "model_"))}
            yield from (f"name wf.{name}.{key}" for key in own)
        if callable(thing) and not (inspect.isclass(thing) and issubclass(thing, Exception | Enum)):
            yield from (f"parameter wf.{name}({key})" for key in inspect.signature(thing).parameters)


def contract() -> list[str]:
    return sorted({*commands(), *scene_keys(), *names()})


def signature(name: str, thing: Any) -> str:
    """How it is called, in lines that a page holds: parameters and defaults, whose types help() says."""
    shown = inspect.signature(thing)
    bare = [one.replace(annotation=one.empty) for one in shown.parameters.values()]
    plain = shown.replace(parameters=bare, return_annotation=shown.empty)
    return fill(f"{name}{plain}", 118, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)


def signatures() -> str:
    """The public names with their signatures, as one block of Markdown."""
    calls = []
    for name in sorted(wakeflow.__all__, key=str.lower):
        thing = getattr(wakeflow, name)
        if inspect.isclass(thing) and issubclass(thing, Exception | Enum | wakeflow.Scene):
            calls.append(f"class {name}({thing.__mro__[1].__name__})")
        else:
            calls.append(signature(f"class {name}" if inspect.isclass(thing) else name, thing))
        if inspect.isclass(thing) and not issubclass(thing, Exception | Enum):
            for key, member in sorted(vars(thing).items()):
                call = getattr(member, "__func__", member)
                if not key.startswith(("_", "model_")) and inspect.isfunction(call):
                    calls.append(signature(f"{name}.{key}", call))
    body = "\n".join(calls)
    return f"```text\n{body}\n```\n"


def test_the_page_of_signatures_is_what_there_is() -> None:
    assert PAGE.read_text().partition(GENERATED)[2] == "\n" + signatures()


def test_nothing_that_others_call_is_lost() -> None:
    assert not set(LIST.read_text().splitlines()) - set(contract())


if __name__ == "__main__":
    LIST.write_text("\n".join(contract()) + "\n")
    PAGE.write_text(f"{PAGE.read_text().partition(GENERATED)[0]}{GENERATED}\n{signatures()}")
