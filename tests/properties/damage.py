"""Damage as hypothesis draws it: bytes that were a good file."""

from __future__ import annotations

import re

from hypothesis import strategies as st

NUMBERS = [b"0", b"-1", b"7", b"100000", b"4294967296", b"1000000000000", b"9" * 30, b"nan", b"inf", b"1e400"]
BINARY = [b"\xff" * 8, b"\0" * 8, (10**12).to_bytes(8, "little"), (2**31 - 1).to_bytes(4, "little"), b"\xff\x7f" * 4]
PIECES = [b'"', b"(", b"}", b"<", b"#", b"!", b"\0", b"\xff", b"\n", b"{" * 3000, b"-", b"[[[["]


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """The content with one to three places changed."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(content)))
        kind = draw(st.sampled_from(["cut", "number", "number", "word", "line", "binary", "insert", "remove", "byte"]))
        if kind == "cut":
            content = content[:at]
        elif kind in ("number", "word"):
            found = list(re.finditer(rb"\d+" if kind == "number" else rb"[@%!]?[A-Za-z_][\w.]*", content))
            if found:
                place = draw(st.sampled_from(found))
                other = draw(
                    st.sampled_from(NUMBERS) if kind == "number" else st.sampled_from(found).map(re.Match.group)
                )
                content = content[: place.start()] + other + content[place.end() :]
        elif kind == "line":
            lines = content.split(b"\n")
            first, second = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
            lines[first] = lines[second]
            content = b"\n".join(lines)
        elif kind == "remove":
            content = content[:at] + content[at + draw(st.integers(1, 40)) :]
        elif kind == "insert":
            content = content[:at] + draw(st.sampled_from(PIECES)) + content[at:]
        else:
            new = draw(st.sampled_from(BINARY) if kind == "binary" else st.binary(min_size=1, max_size=1))
            content = content[:at] + new + content[at + len(new) :]
    return content
