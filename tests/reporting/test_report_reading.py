"""Text, figures and numbers of a page are read as they stand."""

from __future__ import annotations

import pytest
from report_reading import Block, Grid, drawn, grids, sentences, tree, written


def test_text_is_read_by_block_under_its_heading_and_figures_without_their_labels():
    page = tree(
        '<h2 id="a">One</h2><p>It is <b>2</b>\xa0%.</p><p class="sub">3</p>'
        '<svg aria-label="four: 4"><title>5 of 6</title><text>7</text></svg>'
        '<h3 id="b">Two</h3><table><tr><th>k</th></tr><tr><td>8</td></tr></table>'
    )
    assert sentences(page) == [Block("a", "One"), Block("a", "It is 2 %."), Block("b", "Two")]
    assert drawn(page) == [Block("a", "four: 4"), Block("a", "5 of 6")]
    assert grids(page) == [Grid("b", ("k",), (("8",),))]


@pytest.mark.parametrize(
    ("text", "sizes"),
    [
        ("2 min, 1.5e3 and (1.0 +- 0.5)e6", [(120.0, 30.0), (1500.0, 50.0), (1e6, 5e4), (5e5, 5e4)]),
        ("5,800 times 7.9 %", [(5800.0, 50.0), (0.079, 5e-4)]),
    ],
)
def test_numbers_are_read_in_the_size_of_their_units_with_half_of_their_last_digit(text, sizes):
    assert [*written(text)] == [pytest.approx(one) for one in sizes]
