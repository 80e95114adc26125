"""What `imubayes catalogue` prints: all of it, in 80 columns, in words that a terminal without colour has."""

import re
from dataclasses import replace

import pytest
from page_reading import printed

from imubayes.reporting.tables import class_list, class_page
from imubayes.sensors.catalogue import classes, sensor
from imubayes.sensors.catalogue_file import packaged_tables

LETTER = {"datasheet": "d", "second_hand": "s", "order_of_magnitude": "o"}


def _rows(text: str, first: str) -> dict[str, list[str]]:
    """Rows of the table whose heading begins with `first`, by their first cell."""
    lines = text.splitlines()
    start = next(n for n, line in enumerate(lines) if line.startswith(f"{first} "))
    end = next(
        n for n, line in enumerate(lines[start:], start) if not line.strip() or line[1:].startswith("sou")
    )
    return {line.split()[0]: line.split() for line in lines[start + 1 : end] if not line.startswith(" ")}


@pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")
def test_page_prints_every_number_of_a_class_as_it_is_written_with_unit_and_source(entry):
    text = printed(class_page(entry))
    assert max(map(len, text.splitlines())) <= 80 and not re.search("[…\x1b]", text)
    assert printed(class_page(entry), "ascii")
    written = packaged_tables()[entry.kind][entry.id]
    rows = _rows(text, "key")
    figures = {**written["coefficients"], **written["noise"]}
    assert rows.keys() == figures.keys() | {"B", "floor"}
    for key, (*values, unit) in figures.items():
        *_, low, typical, high, shown, d1, d2, d3 = rows[key]
        assert [float(low), float(typical), float(high)] == values, key
        assert shown == unit
        assert [d1, d2, d3] == [LETTER[kind] for kind in entry.origins[key]], key
    for word in (entry.technology, entry.grade, *entry.examples, entry.note, entry.source):
        assert " ".join(word.split()) in " ".join(text.split())
    # the bias instability as coefficient and as floor, one of which is stated
    stated, other = ("floor", "B") if "floor" in written["noise"] else ("B", "floor")
    assert rows[other][-2:] == ["by", stated]
    end = {stated: -4, other: -3}
    numbers = {key: [float(text) for text in rows[key][at - 3 : at]] for key, at in end.items()}
    for B, floor in zip(numbers["B"], numbers["floor"], strict=True):
        assert floor / B == pytest.approx(0.664, rel=0.01)


def test_page_keeps_digits_of_large_ratings_and_temperatures_in_celsius():
    text = printed(class_page(sensor("rlg_tactical", kind="gyroscope")))
    assert "1074 deg/s" in text and "-54 to 85" in " ".join(text.split())


def test_texts_of_a_file_cannot_steer_the_terminal():
    entry = replace(
        sensor("fog_tactical", kind="gyroscope"), id="a\x1b[31m", note="[red]b\x07", examples=("\x1b",)
    )
    for renderable in (class_list([entry]), class_page(entry)):
        text = printed(renderable)
        assert "\x1b" not in text and "\x07" not in text and "a?[31m" in text
    assert "[red]b?" in printed(class_page(entry))
