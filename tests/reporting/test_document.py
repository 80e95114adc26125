import json
import re
import struct
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from lots_found import lot_result
from page_reading import Page, printed, report_html, whole
from results_found import sampled_result, sensor_result, study_result

from imubayes.cli.console import complete
from imubayes.errors import InputError
from imubayes.reporting import figures
from imubayes.reporting.blocks import page_files, write_page
from imubayes.reporting.document import report_page
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.reporting.results import result_json
from imubayes.sensors.terms import library


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        (sensor_result(misfit="centrifuge"), "does not explain run centrifuge"),
        (sampled_result(converged=False), "<strong>ACC-07: the chains have not converged"),
    ],
)
def test_report_says_first_what_is_doubtful_and_marks_it(sensor, said) -> None:
    html = report_html(study_result(sensor))
    assert said in html[html.index('<p class="answer misfit">') : html.index(">The terms<")]


def test_test_that_excites_nothing_is_reported() -> None:
    sensor = sensor_result()
    terms = tuple(replace(term, verdict="untested") for term in sensor.selection.terms)
    models = replace(
        sensor.selection.models,
        candidates=SimpleNamespace(names=()),
        best=(((), 1.0),),
        by_size=np.zeros(1),
        n_models=1,
    )
    selection = replace(sensor.selection, terms=terms, model=(), models=models)
    html = report_html(study_result(replace(sensor, selection=selection)))
    assert "0 of 20 terms are needed" in html and "No term is kept" in html


def test_results_are_written_with_parents_and_replace_older_ones_only(tmp_path, result) -> None:
    out = tmp_path / "deep" / "acc07"
    out.mkdir(parents=True)
    (out / "notes.txt").write_text("mine")
    (out / "result.json").write_text("old")
    with complete(out) as part:
        paths = write_page(report_page(result), result_json(result), part)
    assert [path.name for path in paths] == ["report.html", "result.json", "slide.svg", "slide.png"]
    assert json.loads((out / "result.json").read_text())["study"] == "ACC-07 acceptance"
    assert {path.name for path in out.iterdir()} == {"notes.txt", *(path.name for path in paths)}
    assert [path.name for path in out.parent.iterdir()] == ["acc07"]


def test_slide_of_classes_is_16_to_9_and_has_their_answer(tmp_path) -> None:
    found = lot_result()
    files = {
        path.name: path.read_bytes() for path in write_page(lots_page(found), lots_json(found), tmp_path)
    }
    assert struct.unpack(">II", files["slide.png"][16:24]) == (2200, 1238)
    assert b"consumer MEMS and tactical MEMS need g_i" in files["slide.svg"]
    assert len(files["slide.png"]) < 300_000


def test_failure_leaves_nothing_half_written(tmp_path) -> None:
    with (
        pytest.raises(InputError, match=r"out: cannot be written \(No space left"),
        complete(tmp_path / "out") as part,
    ):
        (part / "report.html").write_text("half")
        raise OSError(28, "No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_report_of_many_components_draws_the_worst_and_stays_below_2_mb() -> None:
    lib = library("accelerometer", powers=2, asymmetry=-1)
    names = [f"imu{k}" for k in range(5)]
    misfit = {"imu3": "stills"}
    triads = [sensor_result(f"{n}.ax", lib=lib, runs=("stills",), misfit=misfit.get(n, "")) for n in names]
    sensors = [replace(t, id=f"{t.id[:-2]}{axis}") for t in triads for axis in ("ax", "ay", "az")]
    page = report_page(study_result(*sensors))
    parts = page_files(page)
    html = parts.pop("report.html")
    assert list(parts) == [f"{k}-{name}.html" for k, name in enumerate(names, 1)]
    for text in (html, *parts.values()):
        assert len(text.encode()) < 2_000_000
        whole(Page(text))
    assert sum(part.count("Autocorrelation of the whitened") for part in parts.values()) == 3
    drawn = html[html.index("Figures are drawn of 3 of the 15 components") :]
    assert 'href="4-imu3.html#s10">imu3.ax' in drawn[: drawn.index("</p>")]
    assert all(f'<a href="{name}">' in html for name in parts)
    back = f'<a href="report.html">{page.title}</a>'
    assert all(back in part and part.count("<h2") == 3 for part in parts.values())


def test_what_is_one_is_in_the_singular() -> None:
    lib = replace(library("accelerometer", powers=1), terms=library("accelerometer", powers=1).terms[:1])
    one = sensor_result(lib=lib, runs=("tumble",))
    told = printed(report_page(study_result(one))) + report_html(study_result(one))
    told += figures.model_size(one, "k").title + figures.inclusion(one, "k").title
    assert "1 run" in told and "1 term" in told
    assert not re.findall(r"(?<![\d.,^])1 (?:terms|runs|models|samples|blocks|digits|units)\b", told)
