import json
from dataclasses import replace

from page_reading import printed, report_html
from results_found import judged_result, study_result

from imubayes.reporting.document import report_page
from imubayes.reporting.results import result_json
from imubayes.selection.panel import Unasked


def test_opinion_that_could_not_be_had_is_named_in_report_terminal_and_file() -> None:
    sensor = judged_result()
    unasked = (Unasked("ssr", "ValueError, <nothing> to drop"), Unasked("reduced model", "no room"))
    panel = replace(sensor.panel, sindy=sensor.panel.sindy[:2], reduced=None, unasked=unasked)
    result = study_result(replace(sensor, panel=panel))
    html = report_html(result)
    assert (
        "Left out: SSR (ValueError, &lt;nothing&gt; to drop)." in html and "Left out: reduced model" in html
    )
    assert "Left out: SSR (ValueError, <nothing> to drop)." in printed(report_page(result))
    (written,) = json.loads(result_json(result))["sensors"]
    assert written["reduced"] is None and set(written["sindy"]) == {"stlsq", "sr3"}
    assert written["unasked"][0] == {"method": "ssr", "reason": "ValueError, <nothing> to drop"}
