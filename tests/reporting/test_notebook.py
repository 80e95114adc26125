"""Results in a notebook, and the notebook of the documentation."""

import json
import re

import numpy as np
import pytest
from results_found import sampled_result, sensor_result, study_result
from update_notebook import NOTEBOOK, executed

import imubayes as ib
from imubayes.errors import InputError


@pytest.fixture(scope="module", autouse=True)
def _equipped():
    assert ib.run and ib.select


def test_result_is_a_data_frame_with_a_row_for_each_term_of_each_component():
    first, second = sensor_result("A"), sensor_result("B")
    frame = study_result(first, second).to_dataframe()
    terms = [*first.selection.terms, *second.selection.terms]
    assert list(frame.term) == [term.name for term in terms]
    assert list(frame.sensor) == ["A"] * len(first.selection.terms) + ["B"] * len(second.selection.terms)
    np.testing.assert_array_equal(frame["mean"], [term.mean for term in terms])
    assert "sensor" not in first.selection.to_dataframe()


def test_result_shows_its_answer_its_picture_and_its_terms_without_loading_or_running_anything():
    html = study_result(title="<A>")._repr_html_()
    assert "ACC-07 needs b0" in html and html.count("<table") == 1 and html.count("<svg") > 1
    assert not any(word in html for word in ("<script", "http:", "https:", "<A>"))
    assert sensor_result()._repr_html_().count("<tr") == 1 + len(sensor_result().selection.terms)


def test_figures_are_those_of_the_report():
    plot = study_result(sampled_result()).plot
    for name in ("terms", "inclusion", "models", "size", "posterior"):
        figure = getattr(plot, name)()
        assert len(figure.axes) == 1 and figure.axes[0].get_children()
    with pytest.raises(InputError, match="expected the id of one"):
        plot.inclusion("none")


def test_draws_are_those_that_are_written(tmp_path):
    arviz = pytest.importorskip("arviz")
    from imubayes.reporting.posterior import write_posterior

    result = study_result(sampled_result())
    write_posterior(result, tmp_path)
    read, made = arviz.from_netcdf(tmp_path / "posterior.nc"), result.to_arviz()
    for name in made.posterior.data_vars:
        np.testing.assert_array_equal(read.posterior[name], made.posterior[name])


def _shown(notebook):
    """Kinds of what each cell shows, cell by cell, and its words without tags and numbers."""
    cells = [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return [
        [(sorted(one["data"]), re.findall(r"[a-z]{3,}", _plain(one["data"]))) for one in cell]
        for cell in cells
    ]


def _plain(data):
    return re.sub(r"<[^>]*>", " ", "".join(data.get("text/html", data["text/plain"])))


def test_notebook_of_the_documentation_runs_and_shows_what_it_holds():
    text = NOTEBOOK.read_text(encoding="utf-8")
    made = _shown(executed(json.loads(text)))
    assert made == _shown(json.loads(text))
    assert sum(len(cell) for cell in made) >= 5
