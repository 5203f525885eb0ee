"""How easily the documents and the messages are read: Flesch's reading ease, of one or of two versions.

    python tests/readability.py             of README, all pages of docs, and the messages
    python tests/readability.py HEAD~20     next to those of an earlier commit

Flesch (1948, J. Appl. Psychol. 32, 221): 206.835 - 1.015 words a sentence - 84.6 syllables a word; 60 is plain English,
30 a scientific paper. Code, tables, links and numbers are left out. Syllables are counted by groups of vowels.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md")))
RAISED = ("SceneError", "less_sure", "void", "information")  # calls whose text a person reads
LEAST_WORDS = 4  # of a sentence that counts


def prose(text: str) -> str:
    """A page without code, tables, pictures, headings and links."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    lines = [line for line in text.splitlines() if not re.match(r"\s*(\||#|<)| {4}", line)]
    return re.sub(r"`[^`]*`", "it", re.sub(r"^\s*([-*]|\d+\.)\s", ". ", "\n".join(lines), flags=re.MULTILINE))


def messages(sources: dict[str, str]) -> str:
    """The texts of all messages in Python sources, what is put in taken for one word."""
    found = []
    for source in sources.values():
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in RAISED and node.args:
                found.append(_text(node.args[0]))
    return ". ".join(found)


def _text(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) if isinstance(part, ast.Constant) else "it" for part in node.values)
    return ""


def reading_ease(text: str) -> tuple[float, float]:
    """Flesch's reading ease, and words a sentence."""
    sentences = [re.findall(r"[A-Za-z][A-Za-z'-]*", part) for part in re.split(r"[.!?;:]+\s|[.!?]$", text)]
    sentences = [words for words in sentences if len(words) >= LEAST_WORDS]
    words = [word for sentence in sentences for word in sentence]
    long = len(words) / len(sentences)
    return 206.835 - 1.015 * long - 84.6 * sum(map(syllables, words)) / len(words), long


def syllables(word: str) -> int:
    """Groups of vowels, without a silent e at the end."""
    word = word.lower()
    silent = word.endswith("e") and not word.endswith(("le", "ee"))
    return max(1, len(re.findall(r"[aeiouy]+", word)) - silent)


def read(path: str, commit: str | None) -> str | None:
    """A file of the checkout, or of a commit; None where it is not there."""
    if commit is None:
        return (ROOT / path).read_text(encoding="utf-8") if (ROOT / path).exists() else None
    found = subprocess.run(["git", "show", f"{commit}:{path}"], cwd=ROOT, capture_output=True, text=True, check=False)
    return found.stdout if found.returncode == 0 else None


def texts(commit: str | None) -> dict[str, str]:
    """What is read, by its name."""
    found = {page: prose(text) for page in PAGES if (text := read(page, commit)) is not None}
    command = ["git", "ls-tree", "-r", "--name-only", commit or "HEAD", "src"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    sources = {path: text for path in listed if path.endswith(".py") and (text := read(path, commit)) is not None}
    return {**found, "messages": messages(sources)}


def main(commit: str | None = None) -> None:
    """Print a row a text: reading ease and words a sentence, before and now."""
    now, before = texts(None), {} if commit is None else texts(commit)
    for name, text in now.items():
        told = ["{:5.1f} ({:4.1f} words)".format(*reading_ease(one)) for one in (before.get(name), text) if one]
        print(f"{name:24s} {'  ->  '.join(told)}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
