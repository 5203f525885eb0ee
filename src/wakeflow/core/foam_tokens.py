"""The words of an OpenFOAM file, cut as OpenFOAM cuts them (1912, tried with its own programs), in time linear in the
file's length whatever it holds.

Where two versions of OpenFOAM cut a text differently, or a list of bytes may hide text from one of them, the token is
of a kind in :data:`DOUBTFUL`: nothing that is refused may lie where only one of the readers sees it.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

Text = bytes | mmap.mmap
Widths = Mapping[bytes, tuple[int, ...]]  # bytes that an entry of a list may take, by the kind of the list


class Token(NamedTuple):
    """A ``kind`` (a group of TOKEN, or one of DOUBTFUL) and its ``text``; a directive's is # and its name alone.
    ``end``: where in the file it ends.
    """

    kind: str
    text: bytes
    end: int


DOUBTFUL = {
    "verbatim": "code between #{ and #}",
    "slashed": "a variable with / in or behind it",  # 1912 takes // for a part of the name, others for a comment
    "condition": "an #if with a string or a comment",  # is read as a line of its own, whatever is open at its end
    "endless": "a string of too many escapes",
    "bytes": "a list of bytes that others may read otherwise",
}
# Numbers and brackets are one token as long as they go on; what opens and does not close goes to the end of the file.
# No group is repeated possessively (a+ behind it): Python before 3.11.5 matches it wrongly
GAP = rb"(?:\s++|//[^\n]*+|(?>/\*.*?\*/))*"
TOKEN = re.compile(
    rb"(?P<numbers>[\s\d.()\[\]eE+-]*[\s\d.()\[\]+-])"
    rb"|(?P<comment>//[^\n]*+|/\*.*?(?:\*/|\Z))"
    rb"|(?P<string>\"[^\"\\]*+(?:\\.[^\"\\]*+){0,999}(?:\"|\Z))"
    rb"|(?P<endless>\")"
    rb"|(?P<verbatim>\#" + GAP + rb"\{)"
    rb"|(?P<directive>\#" + GAP + rb"(?P<name>[^\s\"'/;{}()\[\]#$,=:]*+))"
    rb"|(?P<slashed>\$" + GAP + rb"[^\s\"';/]{0,200}+[^\s\"';])"
    rb"|(?P<variable>\$" + GAP + rb"[^\s\"'/;{}()\[\]#,=:]*+)"
    rb"|(?P<word>[^\s\"'/;{}()\[\]#$,=:]++)"
    rb"|(?P<mark>.)",
    re.S,
)
LINE = re.compile(rb"(?:[^\n\"/]|/(?!\*)){0,300}(?:\n|\Z)")  # in which nothing opens that its end would not close
LISTED = re.compile(GAP + rb"(\d{1,18})" + GAP + rb"\(", re.S)
NUMBERS = {  # in an entry of a list of that kind
    b"scalar": 1, b"sphericalTensor": 1, b"complex": 2, b"vector": 3, b"symmTensor": 6, b"tensor": 9,
    b"label": 1, b"edge": 2, b"bool": 1, b"char": 1,
}  # fmt: skip
NO_BYTES = (b"word", b"string")  # lists of these are text in a binary file too
WHOLE = {  # classes of binary files that are lists from their header on, and what these are of
    b"vectorField": b"vector", b"pointField": b"vector", b"scalarField": b"scalar", b"labelField": b"label",
    b"labelList": b"label", b"faceList": b"label", b"cellList": b"label", b"faceCompactList": b"label",
}  # fmt: skip


def tokens(text: Text, *, binary: bool) -> Iterator[Token]:
    """All of a file but its comments, the numbers in binary lists, and a header that is plain words.

    ``binary``: whether a header may be believed that says so, as one of a field or mesh that no other file includes.
    """
    header, at = header_of(text)
    form = None if header is None else header.get(b"format")
    if header is None or form == b"ascii":
        yield from _cut(text, at)
        return
    widths = _widths(header.get(b"arch", b"")) if binary and form == b"binary" else {}
    kept_as = header.get(b"class", b"") if widths else b""
    if kept_as.startswith(b"Cloud<"):  # parcels, each in its bytes; OpenFOAM takes none of that class for a dictionary
        return
    if kind := WHOLE.get(kept_as):
        for _ in range(2):  # faceCompactList is two lists
            after = _after(text, at, kind, widths)
            if after is None:
                yield Token("bytes", b"", at)
            at = at if after is None else after
    yield from _cut(text, at, widths)


def header_of(text: Text) -> tuple[dict[bytes, bytes] | None, int]:
    """The entries of a file's header FoamFile, and where it ends (bytes). None where it has no such header; no entries,
    and 0, where others than words, strings and numbers make one.
    """
    found: dict[bytes, bytes] = {}
    ahead, key = _cut(text, 0), b""
    if next(ahead, Token("", b"", 0)).text != b"FoamFile":
        return None, 0
    if next(ahead, Token("", b"", 0)).text != b"{":
        return {}, 0
    for kind, word, end in ahead:
        if word == b"}" and not key:
            return found, end
        if word == b";":
            key = b""
        elif not key and kind == "word" and word not in found:
            key, found[word] = word, b""
        elif key and (kind in ("word", "string", "numbers") or word in (b":", b",", b"=")):
            found[key] += word.strip()
        else:
            break
    return {}, 0


def _cut(text: Text, at: int, widths: Widths | None = None) -> Iterator[Token]:
    """The tokens from byte ``at`` on. ``widths``: of the entries of binary lists; none of them where nobody can tell
    whether a list is binary; None where none is.
    """
    while match := TOKEN.match(text, at):
        kind, word, begin, at = match.lastgroup or "", match[0], at, match.end()
        if kind == "comment" or word.isspace():
            continue
        if kind == "directive":
            word = b"#" + match["name"]
        elif kind == "string" and word.startswith(b'"#'):  # a key that is a string is a directive too
            kind, word = "directive", word.strip(b'"')
        if word == b"#if" and not LINE.match(text, at):
            kind = "condition"
        if widths is not None and kind == "word" and word.startswith(b"List<") and LISTED.match(text, at):
            apart = (not begin or text[begin - 1 : begin].isspace()) and text[at : at + 1] in b" \t\r\n\v\f/"
            after = _after(text, at, word[5:-1], widths) if apart else None
            kind, at = ("bytes", at) if after is None else (kind, after)
        yield Token(kind, word, at)


def _after(text: Text, at: int, kind: bytes, widths: Widths) -> int | None:
    """Where the binary list ends that begins at byte ``at`` with its number of entries; ``at`` where it has none, and
    the end of the file where that comes first: nothing can be behind it. None where no width fits.
    """
    found = LISTED.match(text, at)
    if found is None or kind in NO_BYTES or not int(found[1]):
        return at
    ends = [found.end() + int(found[1]) * width for width in widths.get(kind, ())]
    fits = [end + 1 for end in ends if text[end : end + 1] == b")"]
    if fits or not ends:
        return fits[0] if fits else None
    return len(text) if ends[0] >= len(text) else None


def _widths(arch: bytes) -> Widths:
    """Bytes of an entry by a header's entry ``arch``; both widths where it does not tell, the usual one first."""
    found = {}
    for kind, usual in (("scalar", (8, 4)), ("label", (4, 8))):
        told = re.search(rb"%s=(\d+)" % kind.encode(), arch)
        found[kind] = {b"32": (4,), b"64": (8,)}.get(told[1], ()) if told else usual
    sizes = {b"label": found["label"], b"edge": found["label"], b"bool": (1,), b"char": (1,)}
    return {kind: tuple(count * one for one in sizes.get(kind, found["scalar"])) for kind, count in NUMBERS.items()}
