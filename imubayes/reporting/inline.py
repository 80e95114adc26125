"""A figure's SVG as part of a page: short, in the page's font, with ids that no other figure has."""

from __future__ import annotations

import re


def inline(svg: str, key: str) -> str:
    """What is inside of a file of SVG; ids begin with `key`, and those that nothing refers to go."""
    body = svg[svg.index(">", svg.index("<svg")) + 1 : svg.rindex("</svg>")]
    for pattern, replacement in _STRIPPED:
        body = pattern.sub(replacement, body)
    used = set(_REFERENCE.findall(body))
    body = _ID.sub(lambda match: f' id="{key}{match[1]}"' if match[1] in used else "", body)
    body = body.replace('href="#', f'href="#{key}').replace("url(#", f"url(#{key}")
    return _EMPTY_GROUP.sub(r"\1", _WORDS_OR_NUMBER.sub(_shortened, body)).strip()


def _shortened(match: re.Match[str]) -> str:
    """Words with their quotes escaped, or a number with two decimals."""
    text = match[0]
    return text.replace('"', "&quot;") if text[0] == ">" else f"{float(text):.2f}".rstrip("0").rstrip(".")


_STRIPPED = (
    (re.compile(r"<metadata>.*?</metadata>", re.S), ""),
    (re.compile(r"<defs>\s*<style.*?</style>\s*</defs>", re.S), ""),
    (re.compile(r"<!--.*?-->", re.S), ""),
    (re.compile(r"\s*font-family: [^;\"]*;?"), ""),
    (re.compile(r"font-size: 11px; ?"), ""),
    (re.compile(r' transform="rotate\(-0 [^)]*\)"'), ""),
    (re.compile(r"xlink:href"), "href"),
    (re.compile(r"; (?=[a-z-]+:)"), ";"),
    (re.compile(r"\s*\n\s*(?=[LMCQz\"])"), ""),
    (re.compile(r">\s+<"), "><"),
)
_REFERENCE = re.compile(r"(?:href=\"#|url\(#)([\w.-]+)")
_ID = re.compile(r' id="([\w.-]+)"')
_WORDS_OR_NUMBER = re.compile(r">[^<>]+</text>|-?\d+\.\d{3,}")
_EMPTY_GROUP = re.compile(r"<g>((?:<(?!/?g\b)[^>]*>|[^<])*)</g>")
