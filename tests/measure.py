"""Measures the code: python tests/measure.py [COMMIT ...]; a column for each commit, the work tree without one.

    python tests/measure.py --hold      fails where the work tree is larger than tests/size.toml says (tests/run.sh)
    python tests/measure.py --set       writes down how large it is now

A commit that raises a row of tests/size.toml says in its message what was taken away for it.
Lines of code, docstrings, comments and blanks are counted apart, so that fewer lines are not denser lines.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter
from pathlib import Path
from statistics import mean, median

ROOT = Path(__file__).parents[1]
SOURCE, EXTRAS, PROOFS = "src/wakeflow/", "src/wakeflow/extras/", "tests/proofs/"
SIZE = ROOT / "tests" / "size.toml"


def files_of(commit: str | None) -> dict[str, str]:
    """Text of every Python file by its path."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout

    if commit is None:  # there may be no git
        paths = sorted(path for folder in ("src", "tests", "cases") for path in (ROOT / folder).rglob("*.py"))
        return {path.relative_to(ROOT).as_posix(): path.read_text() for path in paths}
    paths = [path for path in git("ls-tree", "-r", "--name-only", commit).splitlines() if path.endswith(".py")]
    return {path: git("show", f"{commit}:{path}") for path in paths}


def kinds(text: str) -> Counter[str]:
    """How many lines are docstring, comment alone, blank and code."""
    tree, lines = ast.parse(text), text.splitlines()
    doc: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and body:
            first = body[0]
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                doc.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    found: Counter[str] = Counter()
    for number, line in enumerate(lines, 1):
        bare = line.strip()
        found["docstring" if number in doc else "blank" if not bare else "comment" if bare[0] == "#" else "code"] += 1
    return found


def functions(text: str) -> list[int]:
    """Lines of each function, its docstring included."""
    kinds_of = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [(n.end_lineno or n.lineno) - n.lineno + 1 for n in ast.walk(ast.parse(text)) if isinstance(n, kinds_of)]


def words(text: str) -> Counter[str]:
    """Names and the two patterns that are counted; strings and comments do not count."""
    found: Counter[str] = Counter()
    tokens = [
        t.string for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type in (tokenize.NAME, tokenize.OP)
    ]
    joined = " ".join(tokens)
    found["Any"] = len(re.findall(r"\bAny\b", joined))
    found["dict[str, Any]"] = joined.count("dict [ str , Any ]")
    found["assert ... is not None"] = len(re.findall(r"\bassert [^;]{1,80}? is not None\b", joined))
    return found


def graph(texts: dict[str, str]) -> tuple[int, int, int, int]:
    """Of the folders and modules below the package, as one graph: rooms, levels, arrows, arrows that run back up."""
    names = {path[len(SOURCE) :].removesuffix(".py").split("/")[0] for path in texts} - {"__init__"}
    arrows: set[tuple[str, str]] = set()
    for path, text in texts.items():
        parts = ["wakeflow", *path[len(SOURCE) :].removesuffix(".py").split("/")]
        room, package = parts[1], parts[:-1]
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                found = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = package[: len(package) - node.level + 1] if node.level else []
                whole = ".".join([*base, *([node.module] if node.module else [])])
                found = [f"{whole}.{alias.name}" for alias in node.names]
            else:
                continue
            others = {name.split(".")[1] for name in found if name.startswith("wakeflow.")} & names
            back = {"__init__"} if any(name == "wakeflow" for name in found) else set()
            if room != "__init__":
                arrows |= {(room, other) for other in others | back if other != room}
    up = {arrow for arrow in arrows if arrow[1] == "__init__"}
    arrows -= up
    level: dict[str, int] = {}

    def floor(room: str, above: tuple[str, ...] = ()) -> int:
        if room not in level:
            below = [other for one, other in arrows if one == room]
            assert not set(below) & set(above), f"a circle through {room}"
            level[room] = 1 + max((floor(other, (*above, room)) for other in below), default=0)
        return level[room]

    return len(names), max(map(floor, names)), len(arrows), len(up)


def measured(commit: str | None) -> dict[str, str]:
    """Every figure by its name."""
    every = files_of(commit)
    source = {path: text for path, text in every.items() if path.startswith(SOURCE)}
    proofs = {path: text for path, text in every.items() if path.startswith(PROOFS)}
    tests = {path: text for path, text in every.items() if path.startswith("tests/") and path not in proofs}
    lines = sum((kinds(text) for text in source.values()), Counter())
    sizes = [size for text in source.values() for size in functions(text)]
    outside = {path: text for path, text in source.items() if "flight/kernel" not in path}
    named = sum((words(text) for text in source.values()), Counter())
    asserts = sum(words(text)["assert ... is not None"] for text in outside.values())
    widths = [len(line) for text in source.values() for line in text.splitlines() if line.strip()]
    rooms, levels, arrows, up = graph(source)
    of_core = graph({path: text for path, text in source.items() if not path.startswith(EXTRAS)})[2]
    return {
        "src: files": f"{len(source)}",
        "src: lines": f"{lines.total()}",
        **{f"src: {kind}": f"{lines[kind]}" for kind in ("code", "docstring", "comment", "blank")},
        "src: mean width of a line": f"{mean(widths):.1f}",
        "src: lines of a function, median / largest": f"{median(sizes):.0f} / {max(sizes)}",
        "src: Any / dict[str, Any]": f"{named['Any']} / {named['dict[str, Any]']}",
        "src: assert ... is not None, outside the kernel": f"{asserts}",
        "rooms / levels / arrows / back up": f"{rooms} / {levels} / {arrows} / {up}",
        "arrows of the eleven rooms": f"{of_core}",
        "proofs: files / lines": f"{len(proofs)} / {sum(len(t.splitlines()) for t in proofs.values())}",
        "tests: files / lines": f"{len(tests)} / {sum(len(t.splitlines()) for t in tests.values())}",
        "cases, other Python: lines": str(sum(len(t.splitlines()) for p, t in every.items() if p.startswith("cases/"))),
    }


def size() -> dict[str, int]:
    """What may not grow without a word: lines of code of each room, values that may be None, modules, lines of docs."""
    found: Counter[str] = Counter()
    for path, text in files_of(None).items():
        if path.startswith(SOURCE):
            room = path[len(SOURCE) :].partition("/")[0].removesuffix(".py")
            found[f"code of {room}"] += kinds(text)["code"]
            found["modules"] += 1
            found["| None"] += text.count("| None")
            found["known()"] += len(re.findall(r"\bknown\(", text))
        elif path.startswith("tests/"):
            found["lines of tests"] += len(text.splitlines())
    found["lines of docs"] = sum(len(page.read_text().splitlines()) for page in (ROOT / "docs").glob("*.md"))
    return dict(sorted(found.items()))


def hold() -> int:
    """Say which rows of the work tree are larger than SIZE allows; how many."""
    allowed = tomllib.loads(SIZE.read_text())
    larger = [
        f"{row}: {now}, {allowed.get(row, 0)} allowed" for row, now in size().items() if now > allowed.get(row, 0)
    ]
    for line in larger:
        print(f"{line}; take something away, or raise it in {SIZE.name} and say in the commit what went for it")
    return len(larger)


if __name__ == "__main__":
    if sys.argv[1:] == ["--set"]:
        SIZE.write_text("".join(f'"{row}" = {now}\n' for row, now in size().items()))
    if sys.argv[1:] in (["--set"], ["--hold"]):
        sys.exit(hold() > 0)
    commits: list[str | None] = list(sys.argv[1:]) or [None]
    columns = [measured(commit) for commit in commits]
    for name in columns[0]:
        print(f"{name:50}", *(f"{column[name]:>16}" for column in columns))
