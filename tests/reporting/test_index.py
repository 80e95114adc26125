"""The list of a folder's reports: what it says, where it is written, and where not."""

import re
from functools import cache

import pytest
from results_found import study_result

from imubayes.errors import InputError
from imubayes.reporting.blocks import write_page
from imubayes.reporting.document import report_page
from imubayes.reporting.index import renew_index, write_index
from imubayes.reporting.results import result_json


@cache
def _page():
    found = study_result(title='"<A> & B"')
    return report_page(found), result_json(found)


def _report(folder):
    folder.mkdir(parents=True)
    write_page(*_page(), folder)
    return folder


def test_list_has_question_answer_data_fit_and_date_and_each_page_leads_home(tmp_path):
    folders = [_report(tmp_path / "reports" / name) for name in "ab"]
    text = write_index(tmp_path / "reports").read_text()
    assert re.findall(r'<a href="(\w+/report.html)">&#34;&lt;A&gt; &amp; B&#34;</a>', text) == [
        "a/report.html",
        "b/report.html",
    ]
    page = (folders[0] / "report.html").read_text()
    for name in ("description", "question", "data", "fit", "date"):
        told = re.search(rf'<meta name="{name}" content="([^"]+)">', page)[1]
        assert text.count(told) >= 2, name
    assert '<a href="../index.html">' in page


def test_list_names_its_folder_as_the_run_did(tmp_path, monkeypatch):
    one = _report(tmp_path / "reports" / "a")
    monkeypatch.chdir(tmp_path)
    renew_index(one.relative_to(tmp_path))
    assert "<pre>imubayes index reports</pre>" in (tmp_path / "reports" / "index.html").read_text()


def test_list_is_made_in_folders_of_reports_alone_and_replaces_no_other_file(tmp_path):
    one = _report(tmp_path / "here" / "a")
    assert "index.html" not in (one / "report.html").read_text()
    assert renew_index(one) == () and not (tmp_path / "here" / "index.html").exists()
    write_index(tmp_path / "here")
    assert renew_index(one) == (tmp_path / "here" / "index.html",)
    (tmp_path / "here" / "index.html").write_text("mine")
    assert renew_index(one) == ()
    with pytest.raises(InputError, match="no list of reports"):
        write_index(tmp_path / "here")
    with pytest.raises(InputError, match=r"no \*/report.html"):
        write_index(tmp_path)
