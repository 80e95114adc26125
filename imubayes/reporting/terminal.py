"""Text for the terminal."""

from __future__ import annotations

from rich.padding import Padding
from rich.text import Text


def indented(text: str, style: str = "") -> Padding:
    """Paragraph that stands a little in, printable."""
    return Padding(Text(printable(text), style=style), (0, 0, 0, 1))


def printable(text: str) -> str:
    r"""Names come from files: what is not printable does not reach the terminal.

    Examples
    --------
    >>> printable("ACC\x1b[2J-07")
    'ACC?[2J-07'
    """
    return "".join(sign if sign.isprintable() else "?" for sign in text)
