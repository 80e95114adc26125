"""What the residuals say: whether the model explains the data, and what it lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from block_readings import panels, rows
from results_found import judged_result, sampled_result

from imubayes.inference.known_quantities import Recovered
from imubayes.reporting.fit_views import MOST_DEPENDENCES, dwell_sections, fit_sentence, misfit_sections


def test_a_residual_s_title_and_the_sentences_on_what_is_missing_are_one_decision() -> None:
    """What is drawn as found is in the sentence on what is missing, and not in that on what is not."""
    sensor = judged_result()
    some = sensor.misfit
    assert some.found
    none = replace(some, found=(), dependences=[replace(one, p=0.4) for one in some.dependences])
    for misfit in (some, none):
        (section,) = misfit_sections(replace(sensor, misfit=misfit), "k", drawn=True)
        text, nothing, figure = section.blocks
        titles = [panel.title for panel in figure.panels]
        assert len(titles) == (min(len(misfit.found), MOST_DEPENDENCES) or 1)
        for title, one in zip(titles, misfit.found or misfit.dependences[:1], strict=False):
            where = one.where
            assert title.startswith(f"{where}: ") and (where in str(text.texts)) is bool(misfit.found)
            assert (f"{one.channel} (p" in str(nothing.texts)) is (not misfit.found)


def test_what_is_found_is_drawn_else_the_input_against_which_most_is_left() -> None:
    sensor = judged_result()
    (found,) = panels(misfit_sections(sensor, "s1", drawn=True))
    assert found.title.startswith("T between heating and cooling") and "28 µg rms, 41% of" in found.title
    settled = replace(sensor, misfit=replace(sensor.misfit, found=()))
    assert len(panels(misfit_sections(settled, "s1", drawn=True))) == 1
    assert not panels(misfit_sections(sensor, "s1", drawn=False))


@pytest.mark.parametrize(("kind", "si"), [("accelerometer", 9.80665e-6), ("gyroscope", 4.84813681109536e-6)])
def test_offset_of_a_dwell_is_in_the_unit_of_the_output(kind, si) -> None:
    sensor = sampled_result()
    dwell = replace(sensor.distrusted[0], offset=120.0 * si, sd=3.0 * si)
    (row,) = rows(dwell_sections(replace(sensor, kind=kind, distrusted=(dwell,))))
    assert row[-1].startswith("120.0 ± 3.0 ")


def test_error_bars_are_judged_by_the_errors_of_known_quantities_wherever_there_are_some() -> None:
    """Residuals below the noise beside stills that are off by twice what is predicted: one statement."""
    sensor = judged_result()
    weak = (replace(sensor.checks[0], scale=0.6, whiteness_p=0.4, outliers=(), fits=False),)
    after, sd = np.repeat([3.0, 0.5], [8, 13])[:, None], np.ones((21, 1))
    off = Recovered("hand", "gravity", after, after, after, sd, 2.0 * sd)
    wide = replace(off, after=np.full((21, 1), 0.1))
    bare = fit_sentence(replace(sensor, checks=weak, recovered=()))
    assert "so the error bars are wider than they need be." in bare
    told = fit_sentence(replace(sensor, checks=weak, recovered=(off,)))
    assert "error bars are too small: 13 of 21 errors of known quantities" in told and "wider" not in told
    right = fit_sentence(replace(sensor, checks=weak, recovered=(wide,)))
    assert "known quantities are as predicted: 21 of 21" in right
