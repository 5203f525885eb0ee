"""What one OpenFOAM file says that matters to :mod:`.foam_code`: code, libraries by their path, files it includes, and
what it gives a key.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache

from .foam_tokens import DOUBTFUL, Text, Token, header_of, tokens

NEEDED = (b"#", b'"', b"ode", b"ibs", b"systemCall")  # a file with none of these holds nothing that is refused
HARMLESS = (
    b"#include", b"#includeIfPresent", b"#sinclude", b"#includeFunc", b"#inputMode", b"#remove", b"#if", b"#ifeq",
    b"#else", b"#endif", b"#neg", b"#negate", b"#message",
)  # fmt: skip
INCLUDES = (b"#include", b"#includeIfPresent", b"#sinclude", b"include")  # the last one as old versions have it
FROM_ETC = (b"#includeEtc", b"#sincludeEtc")  # of OpenFOAM's installation
KEYS_OF_CODE = frozenset((
    b"code", b"codeInclude", b"codeOptions", b"codeLibs", b"codeData", b"codeRead", b"codeExecute", b"codeWrite",
    b"codeEnd", b"codeContext", b"localCode",
))  # fmt: skip
LIBS = (
    b"libs", b"functionObjectLibs", b"motionSolverLibs", b"dynamicFvMeshLibs", b"algebraicGAMGAgglomerationLibs",
    b"geometricGAMGAgglomerationLibs",
)  # fmt: skip
# A pattern that POSIX and Python read alike, and soon: any other counts as one that matches
PATTERN = re.compile(rb"(?:[^\\\[\](){}*+?|^$][*+?]?|\[\^?[\w.,-]+\][*+?]?|[()|^$](?![*+?])){0,60}")
BRANCHES = 3  # groups and repeats in such a pattern, at most


def is_plain(text: Text) -> bool:
    """Whether a file, of numbers as most are, has nothing in it that all need that is refused."""
    _, begin = header_of(text)
    return all(text.find(needed, begin) < 0 for needed in NEEDED)


class Reader:
    """Looks at the tokens of a file one after the other; ``included``: the names of files that were asked for."""

    def __init__(self) -> None:
        self.included: list[bytes] = []
        self.owed = b""  # the directive whose argument comes next
        self.depth: int | None = None  # of brackets in the value of libs; None: in none
        self.begins = False  # whether that value comes next

    def refused(self, token: Token) -> str | None:
        """What is wrong with a token behind those before it, None where nothing is."""
        if token.kind in DOUBTFUL:
            return DOUBTFUL[token.kind]
        found, name = None, token.text.strip(b'"') if token.kind in ("word", "string") else b""
        if self.owed:
            found = self._argument(token, name)
        if token.kind == "directive":
            found = found or self._directive(token)
        elif name:
            self.owed = name if name == b"include" else b""
            found = found or _code_in(name)
        if self.depth is not None:
            return found or self._library(token)
        if name:
            self.depth = 0 if _names_libs(token, name) else None
            self.begins = True
        return found

    def _directive(self, token: Token) -> str | None:
        self.owed = token.text
        if token.text in FROM_ETC:
            return f"an include from outside of the case, {shown(token.text)}"
        return shown(token.text) if token.text not in HARMLESS else None

    def _argument(self, token: Token, name: bytes) -> str | None:
        """What comes behind a directive, or the word include."""
        owed, self.owed = self.owed, b""
        if owed == b"#includeFunc" and (not name or re.search(rb"[/$~\\]", name)):
            return f"an include from outside of the case, {shown(token.text)}"
        if owed in INCLUDES and token.kind == "string":
            self.included.append(name)
        elif owed in INCLUDES and owed != b"include":
            return f"an include of what is no string, {shown(token.text)}"
        return None

    def _library(self, token: Token) -> str | None:
        """The value of libs, up to the ; that ends it: a list in brackets of one kind or another, not a dictionary."""
        kind, text, depth = token.kind, token.text, self.depth or 0
        begins, self.begins = self.begins, False
        if kind == "directive" or b"/" in text or b"$" in text:
            return "libs with the path of a file"
        if kind == "numbers":
            depth += text.count(b"(") - text.count(b")")
        elif kind == "mark":
            depth += (text == b"{") - (text == b"}")
        ends = (text == b";" and depth == 0) or (text == b"{" and begins) or depth < 0
        self.depth = None if ends else depth
        return None


def shown(text: bytes) -> str:
    """The beginning of a text of a file, for a message."""
    return text[:60].decode("latin-1")


def _code_in(name: bytes) -> str | None:
    """What of code a word is, or a string that is one word: OpenFOAM takes either."""
    if b"oded" in name and re.search(rb"[cC]oded", name) and not re.search(rb"\s", name):
        return "a coded condition"
    if name == b"systemCall":
        return "systemCall"
    return f"code, the entry {shown(name)}" if name in KEYS_OF_CODE else None


def _names_libs(token: Token, name: bytes) -> bool:
    """Whether a word, or a string as a pattern, may be the key of libraries to load."""
    if token.kind == "word":
        return name.endswith((b"libs", b"Libs"))
    last = name.rpartition(b"/")[2]  # newer versions take a string for a path of keys
    return last.endswith((b"libs", b"Libs")) or _may_match(name, LIBS) or (last != name and _may_match(last, LIBS))


@lru_cache(maxsize=4096)
def _may_match(pattern: bytes, names: tuple[bytes, ...]) -> bool:
    """Whether a pattern, as POSIX has them, matches one of the names; or may."""
    if not PATTERN.fullmatch(pattern) or len(re.findall(rb"[*+?(]", pattern)) > BRANCHES:
        return True
    try:
        matches = re.compile(pattern).fullmatch
    except re.error:
        return True
    return any(matches(name) for name in names)


def values_of(text: Text, name: bytes, *, binary: bool) -> Iterator[bytes | None]:
    """What a file gives the key ``name``, or a pattern that matches it; None for what is more than words and numbers,
    and for a dictionary.
    """
    _, begin = header_of(text)
    if text.find(name, begin) < 0 and text.find(b'"', begin) < 0:
        return
    value: list[Token] | None = None
    is_key, loose, pattern = True, False, False
    for token in tokens(text, binary=binary):
        ends = token.text in (b";", b"{", b"}")
        if value is not None and not ends:
            value.append(token)
            continue
        if value is not None:
            if token.text != b"{" or value or not pattern:  # what a pattern gives a dictionary is for others
                yield _joined(value) if token.text != b"{" else None
            value = None
        elif is_key and token.kind in ("word", "string"):
            key = token.text.strip(b'"').rpartition(b"/")[2]
            pattern = key != name
            value = [] if key == name or (token.kind == "string" and _may_match(key, (name,))) else None
        loose = token.kind == "directive" or (loose and not ends)  # behind its arguments, which have no end
        is_key = ends or loose
    if value is not None:
        yield _joined(value)


def _joined(value: list[Token]) -> bytes | None:
    if len(value) == 1 and value[0].kind == "string":
        return value[0].text.strip(b'"')
    plain = all(token.kind in ("word", "numbers") for token in value)
    return b" ".join(token.text.strip() for token in value) if plain else None
