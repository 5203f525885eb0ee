"""docs/architecture.md, made of the rooms' own words and the types of a run: ``python tests/architecture_page.py``."""

import ast
import inspect
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from textwrap import fill

import wakeflow

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
SOURCE = ROOT / "src" / "wakeflow"
INNER = {"air": ("mesh", "foam", "field", "kinds"), "flight": ("kernel", "collisions", "feed", "stages")}
# What a run hands on, in order: the value, and the function that makes it
CHAIN = (
    ("wakeflow.scene.scene:Scene", "wakeflow.scene.scene:Scene.load"),
    ("wakeflow.planning.plan:Plan", "wakeflow.runs.planned:make_plan"),
    ("wakeflow.air.kinds.airflow_kinds:FlownAir", "wakeflow.flight.stages.pipeline:Pipeline"),
    ("wakeflow.flight.granules:Granules", "wakeflow.flight.feed.feedstock:feedstock"),
    ("wakeflow.flight.tracks:Tracks", "wakeflow.flight.driver:track"),
    ("wakeflow.flight.stages.landings:Tracked", "wakeflow.flight.stages.pipeline:Pipeline.tracks"),
    ("wakeflow.answer.joint:JointAnswer", "wakeflow.answer.separation:joint_answer"),
    ("wakeflow.answer.result:Result", "wakeflow.runs:run"),
)
ABOUT = """\
# Architecture

The package is twelve rooms, in the order in which a run uses them: each imports only those before it. What a run hands
on from room to room are the values below. Read this page first, then [developing.md](developing.md), which says how the
code is tested, keyed and cached, and [extending.md](extending.md), which says what a new law, force or shape needs.
`python tests/architecture_page.py` makes this page from the docstrings.
"""


def room(name: str) -> str:
    """The section of a room: its docstring, and its folders by theirs."""
    text = _docstring(SOURCE / name / "__init__.py")
    lines = [f"### {name}\n\n{_wrapped(text)}\n"]
    for inner in INNER.get(name, ()):
        said = _docstring(SOURCE / name / inner / "__init__.py").split("\n\n")[0]
        lines.append(_wrapped(f"- `{name}.{inner}`: {said}", "  ") + "\n")
    return lines[0] + ("\n" + "".join(lines[1:]) if lines[1:] else "")


def _docstring(path: Path) -> str:
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""


def _wrapped(text: str, indent: str = "") -> str:
    """Paragraphs of Markdown: no roles of Sphinx, 120 columns."""
    plain = re.sub(r":\w+:`~?\.*([\w.]+)`", r"`\1`", text).replace("``", "`")
    parts = [" ".join(part.split()) for part in plain.split("\n\n")]
    return "\n\n".join(
        fill(part, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False) for part in parts
    )


def value(kind: str, maker: str) -> str:
    """The row of a value: its name, what it is, what it holds, what makes it."""
    thing = _found(kind)
    _found(maker)  # is there
    means = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split()).replace("``", "`")
    means = re.sub(r":\w+:`~?\.*([\w.]+)`", r"`\1`", means).partition(". ")[0].rstrip(".:")
    held = fields(thing) if is_dataclass(thing) else ()
    names = [one.name for one in held if not one.name.startswith("_")] or list(getattr(thing, "model_fields", {}))
    shown = ", ".join(f"`{name}`" for name in names[:8]) + (", ..." if len(names) > 8 else "")
    return f"| `{kind.replace(':', '.')}` | {means} | {shown} | `{maker.replace(':', '.')}` |\n"


def _found(name: str) -> object:
    module, _, path = name.partition(":")
    found: object = import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    return found


def page() -> str:
    """The whole page."""
    values = "".join(value(kind, maker) for kind, maker in CHAIN)
    head = "| value | what it is | what it holds | made by |\n|---|---|---|---|\n"
    rooms = "\n".join(room(name) for name in wakeflow.LAYERS)
    return f"{ABOUT}\n## The values of a run\n\n{head}{values}\n## The rooms\n\n{rooms}"


if __name__ == "__main__":
    PAGE.write_text(page())
