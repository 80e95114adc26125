from dataclasses import replace

import numpy as np
import pytest

from imubayes.algebra.factor import least_squares, reorder
from imubayes.errors import ConvergenceError
from imubayes.inference.summary import summarize
from imubayes.sensors.terms import library
from studies.decision_quality import trials as trying
from studies.decision_quality.subjects import runs_of, subject
from studies.decision_quality.trials import MISSING, MODELLED, OWN, SMALL, STRONG, QualityStudy, trials


@pytest.fixture(scope="module")
def found():
    told: list[str] = []
    some = replace(SMALL, treatments=(MODELLED, MISSING))
    return trials(some, progress=lambda doing, share=None: told.append(doing)), told


def reference_of(kind, number, classes=(), **options):
    one = subject(library(kind, **options), number, 7, classes)
    summary = summarize(runs_of(one), one.library, sensor=one.sensor)
    return one, summary, trying._Reference.of(one, summary)


def test_decision_comes_first_and_needed_terms_are_among_those_it_keeps(found):
    for trial in found[0]:
        assert trial.methods[:3] == OWN
        assert "evidence" not in trial.methods
        said, shape = trial.said[:3], (len(trial.methods), len(trial.terms))
        assert trial.keeps.shape == trial.strength.shape == trial.said.shape == trial.pull.shape == shape
        assert np.all(trial.keeps[:3][said == 1.0] == 1.0)
        assert np.all(trial.keeps[:3][said == 0.0] == 0.0)
        np.testing.assert_array_equal(trial.keeps[:3], trial.strength[:3] >= 0.5)
        np.testing.assert_array_equal(np.isnan(trial.pull[:3]), np.isnan(said))
        assert np.all(np.isnan(trial.pull[3:]))


def test_missing_term_is_a_strong_true_one_that_no_method_is_asked_about(found):
    for trial in found[0]:
        if trial.treatment == MISSING:
            whole = next(t for t in found[0] if t.kind == trial.kind and t.treatment == MODELLED)
            where = whole.terms.index(trial.missing)
            assert whole.effect[where] > STRONG
            assert whole.truth[where] != 0.0
            assert trial.terms == tuple(name for name in whole.terms if name != trial.missing)
        else:
            assert trial.missing == ""


def test_effect_over_noise_is_the_size_over_the_sd_of_least_squares():
    one, summary, reference = reference_of("accelerometer", 0, powers=2, asymmetry=-1)
    tested = tuple(n for n, norm in zip(summary.names, summary.factor.column_norms, strict=True) if norm > 0)
    fit = least_squares(reorder(summary.factor, tested))
    own = reference.scale / np.sqrt(fit.rss / fit.dof)
    for name, sd in zip(tested, fit.sd, strict=True):
        expected = abs(one.truth[name]) / (sd * own)
        # a prior a thousand times as wide as the class's holds what it holds to 1e-6 of its square
        assert reference.effect(name, one.truth) == pytest.approx(expected, rel=1e-4)
    assert own == pytest.approx(1.0, rel=1e-2)


@pytest.mark.slow
def test_a_tilt_that_no_bench_has_does_not_pass_for_the_term_that_is_missing():
    # 14 sd of it leave dwells on the centrifuge nothing to say, and would have m_j and c_ij needed
    one, _, reference = reference_of("accelerometer", 6, QualityStudy().classes, powers=3, asymmetry=1)
    trial = trying._trial(one, reference, MISSING, 2)
    assert trial.missing == "c_jk"
    assert not np.any(trial.said[0][trial.truth == 0.0] == 1.0)
    assert np.nanmax(np.abs(trial.pull[0])) < 4.0


def test_sensor_that_the_analysis_refuses_is_left_open(monkeypatch):
    def refusing(spec, runs, seed):
        raise ConvergenceError("mounts did not settle", None)

    monkeypatch.setattr(trying, "_evidence", refusing)
    (trial,) = trying.judge(replace(SMALL, treatments=()), "gyroscope", 0)
    assert trial.refused == "mounts did not settle"
    assert np.all(np.isnan(trial.said[:2]))
    assert not np.all(np.isnan(trial.said[2]))
