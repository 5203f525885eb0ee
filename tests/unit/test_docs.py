"""What the documents name is there: files, modules, public names, anchors, commands that the command line parses.

Their sentences use plain words: subject, verb, object, and no idiom that only this program uses.
"""

import ast
import importlib
import pydoc
import re
from pathlib import Path

import pytest

import architecture_page
import wakeflow
from pages import PAGES, commands_in, parse_command, shell_lines, spans
from readability import prose, reading_ease
from support import ROOT
from wakeflow.laws.forces import forces
from wakeflow.planning.stages import OTHER_MESHES, stages
from wakeflow.planning.terms import bounds

SOURCE = ROOT / "src" / "wakeflow"
TOP = {"src", "tests", "cases", "docs", "meshes", *wakeflow.LAYERS}  # a path begins with one of these
EASE, WORDS = 73.0, 15.0  # of every page: Flesch's reading ease at least, words a sentence at most
PRODUCED = ("runs/", "figures/", "cases/template/turbulence-models/")  # what a run writes, or an example would add
SUFFIXES = (".py", ".toml", ".sh", ".j2", ".liggghts")

# What a reader whose first language is not English stumbles over, and what to write instead
BANNED_IN_SOURCES = {
    r"\bhang(?:s|ing)? (?:most )?on\b": "depends on",
    r"\bstands? (?:beside|for|in|at|with|behind)\b": "is next to, represents, is",
    r"\b(?:is|are|was|were|be) told\b(?! apart)": "is reported",
    r"\bwhat it is at\b": "what it does",
    r"\bof its own accord\b": "by itself",
    r"\bthe house\b": "the package",
}
BANNED = BANNED_IN_SOURCES | {
    r"\bbeside\b": "next to, compared with, in addition to",
    r"\b(?:is|are|was|were) told\b": "is reported",
    r"\b(?:stands?|stood) (?:in|for|at|with|behind|between|still)\b": "is, represents, does not change",
    r"\bof (?:its|their) own\b": "separate",
    r"^\W*(?:Known|Mended)\.": "a whole sentence",
}

page = pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)


def _words(page: Path) -> set[str]:
    """Words of code, spans and shell lines, that may be paths."""
    lines = (*spans(page.read_text()), *shell_lines(page))
    words = {word.strip("(),;:") for line in lines for word in line.split()}
    placeholder = re.compile(r"[*<>{}=\"']|NAME|STAGE|KEY")
    return {word.removesuffix("/") for word in words if not placeholder.search(word)}


@page
def test_files_exist(page: Path) -> None:
    missing = []
    for word in _words(page):
        named = word.split("/")[0] in TOP and "/" in word and not word.startswith(PRODUCED)
        there = any((base / word).exists() for base in (ROOT, SOURCE))
        if (named or word.endswith(SUFFIXES)) and word != "my.toml" and not there:
            missing.append(word)
    assert not missing


@page
def test_modules_and_names_exist(page: Path) -> None:
    text = page.read_text()
    for name in set(re.findall(r"\bwakeflow((?:\.[a-z_]\w*)+)", text)):
        assert _is_there(name.strip(".").split(".")), f"wakeflow{name}"
    for name in set(re.findall(r"\bwf\.(\w+)", text)):
        assert name in wakeflow.__all__, f"wf.{name}"


def _is_there(parts: list[str]) -> bool:
    """A module of the package, a name in one, or a name of the package itself."""
    if parts[0] in wakeflow.__all__ or parts[0] in vars(wakeflow):
        return True
    for cut in range(len(parts), 0, -1):
        base = SOURCE.joinpath(*parts[:cut])
        if base.is_dir() or base.with_suffix(".py").exists():
            module = importlib.import_module(".".join(["wakeflow", *parts[:cut]]))
            return cut == len(parts) or hasattr(module, parts[cut])
    return False


@page
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text()
    targets = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    for target in targets:
        if "://" in target or target.startswith("doi"):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), target
        assert not anchor or anchor in _anchors(file), target


def _anchors(file: Path) -> set[str]:
    """Anchors that a page's headings get: lower case, blanks become hyphens, punctuation goes."""
    headings = re.findall(r"^#+ (.+)$", file.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@page
def test_commands_in_the_text_parse(page: Path) -> None:
    """Those of fenced blocks: tests/unit/test_examples.py."""
    for command in commands_in(spans(page.read_text())):
        parse_command(command)


@page
def test_prose_is_wrapped(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    lines = [line for line in text.splitlines() if not line.startswith(("|", "<", "    ")) and "](" not in line]
    assert not [line for line in lines if len(line) > 120]


def _prose(text: str) -> str:
    """The running text, in one line a paragraph or item: no code, heading, row of a table or address of a link."""
    text = re.sub(r"^(?:```.*?^```|[#|].*?$|    .*?$)", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"\]\([^)]*\)|`[^`]*`", "", text)
    return re.sub(r"\n(?!\n| *- )", " ", text)


def _unclear(text: str, banned: dict[str, str]) -> list[str]:
    """Every banned fragment in a text, with the words round it and what to write instead."""
    return [
        f"{text[max(0, hit.start() - 40) : hit.end() + 20].strip()!r}: write {instead}"
        for pattern, instead in banned.items()
        for hit in re.finditer(pattern, text, re.IGNORECASE | re.MULTILINE)
    ]


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=lambda path: path.name)
def test_sentences_use_plain_words(page: Path) -> None:
    assert _unclear(_prose(page.read_text()), BANNED) == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=lambda path: path.name)
def test_sentences_are_short_and_easy_to_read(page: Path) -> None:
    """Plain English has a reading ease of 60; numbers and names of formulas make a page of physics look easier."""
    ease, words = reading_ease(prose(page.read_text()))
    assert ease > EASE, f"Flesch's reading ease {ease:.0f}: use shorter words and sentences"
    assert words < WORDS, f"{words:.1f} words a sentence: make two sentences of the longest"


def test_messages_and_docstrings_use_plain_words() -> None:
    found = []
    for file in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = " ".join(node.value.split())
                found += [f"{file.name}: {one}" for one in _unclear(text, BANNED_IN_SOURCES)]
    assert found == []


@pytest.mark.parametrize("text", ["The share hangs\nmost on it.", "*Known.* It is so.", "Beside it lies another."])
def test_an_unclear_sentence_is_found(text: str) -> None:
    assert len(_unclear(_prose(text), BANNED)) == 1


def test_the_architecture_is_what_the_rooms_say() -> None:
    """Brought up to date by: python tests/architecture_page.py."""
    assert (ROOT / "docs" / "architecture.md").read_text() == architecture_page.page()


def test_help_begins_with_a_screen_and_shows_no_addresses() -> None:
    text = pydoc.plain(pydoc.render_doc(wakeflow))
    assert "The rest of help() is the reference" in "\n".join(text.splitlines()[:32])
    assert re.findall(r".* at 0x[0-9a-f]+", text) == []


def test_the_glossary_has_the_words_of_the_output() -> None:
    text = (ROOT / "docs" / "glossary.md").read_text()
    rungs = ["none", "analytic", "given", "draft", "standard", "reference"]
    headings = {OTHER_MESHES, *(stages[name].heading for name in stages)}
    words = [*(fate.name.lower() for fate in wakeflow.Fate), *rungs, *forces, *bounds, *headings]
    assert not [word for word in words if f"*{word}*" not in text]
