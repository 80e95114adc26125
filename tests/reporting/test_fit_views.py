"""What the residuals say: whether the model explains the data, and what it lacks."""

from dataclasses import replace

from results_found import judged_result

from imubayes.reporting.fit_views import MOST_DEPENDENCES, misfit_sections


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
