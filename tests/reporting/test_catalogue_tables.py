"""What `imubayes catalogue` prints: all of it, in 80 columns, in words that a terminal without colour has."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from page_reading import printed

from imubayes.reporting.tables import class_list, class_page
from imubayes.sensors.catalogue import classes, sensor
from imubayes.sensors.catalogue_file import packaged_tables

every_class = pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")
LETTER = {"datasheet": "d", "second_hand": "s", "order_of_magnitude": "o"}


def _fits(text: str) -> bool:
    return max(map(len, text.splitlines())) <= 80 and not re.search("[…\x1b]", text)


def test_list_names_every_class_once_with_its_technology_and_sizes():
    text = printed(class_list(classes()))
    assert _fits(text)
    ids = [line.split()[0] for line in text.splitlines() if line and not line.startswith(" ")]
    assert [id for id in ids if id in {entry.id for entry in classes()}] == [entry.id for entry in classes()]
    fog = next(line for line in text.splitlines() if line.startswith("fog_navigation"))
    assert fog.split()[-4:] == ["0.01", "15", "0.0015", "0.002"]  # deg/h, ppm, deg/sqrt(h), deg/h
    piga = next(line for line in text.splitlines() if line.startswith("strategic_piga"))
    assert piga.split()[-4:] == ["1", "1", "0.3", "0.0753"]  # ug, ppm, ug/sqrt(Hz), ug: a floor of 0.05
    words = " ".join(text.split())
    assert "closed-loop IFOG" in words and "SRS-1000" in words


def _rows(text: str, first: str) -> dict[str, list[str]]:
    """Rows of the table whose heading begins with `first`, by their first cell."""
    lines = text.splitlines()
    start = next(n for n, line in enumerate(lines) if line.startswith(f"{first} "))
    end = next(
        n for n, line in enumerate(lines[start:], start) if not line.strip() or line[1:].startswith("sou")
    )
    return {line.split()[0]: line.split() for line in lines[start + 1 : end] if not line.startswith(" ")}


@every_class
def test_page_prints_every_number_of_a_class_as_it_is_written_with_unit_and_source(entry):
    text = printed(class_page(entry))
    assert _fits(text) and printed(class_page(entry), "ascii")
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


@every_class
def test_page_prints_bias_instability_as_coefficient_and_as_floor_and_says_which_is_stated(entry):
    rows = _rows(printed(class_page(entry)), "key")
    stated = "floor" if "floor" in packaged_tables()[entry.kind][entry.id]["noise"] else "B"
    other = {"B": "floor", "floor": "B"}[stated]
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
