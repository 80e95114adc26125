"""The hours of a class: what is foreseen for a repeated campaign, and when a term is told."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plan_studies import plan_of

from imubayes.algebra.factor import noise_scale, posterior
from imubayes.campaign.preparation import prepare
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.planning.hours import REACH, campaign_pass, hours, known, posterior_ratios, ratio_enough
from imubayes.population import simulate_unit
from imubayes.selection.decision import select
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.lots import draw_lot
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import library
from imubayes.work import silent

LOTS = """
[study]
seed = 3
[lots]
kind = "gyroscope"
classes = ["mems_tactical"]
[lots.library]
powers = 2
asymmetry = 1
[lots.reference]
rate_scale = "50 ppm"
fixture = "20 arcsec"
[[lots.run]]
name = "rates"
procedure = "rate-table"
[lots.run.simulate]
rates = ["20 deg/s", "-20 deg/s", "100 deg/s", "-100 deg/s"]
mounts = 9
dwell = "30 s"
rate = "1 Hz"
[[lots.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 12, planes = 3, dwell = "30 s", rate = "1 Hz", latitude = "45 deg" }
"""


@pytest.fixture
def study(tmp_path):
    return plan_of(tmp_path, LOTS)


def _fitted(study, passes: int, unit: int, rule: NoiseRule) -> np.ndarray:
    """Posterior over prior sd of each term of a simulated unit that went through the campaign so often."""
    (spec,), entry = study.specs, study.classes[0]
    lot = draw_lot(entry, study.library, 1, np.random.default_rng([1, unit]))
    lot = replace(lot, noise=(typical_noise(entry),))
    runs = (replace(run, name=f"{run.name} {k}", noise=rule) for k in range(passes) for run in spec.runs)
    spec = replace(spec, runs=tuple(runs), truth=lot.truth(0))
    made = simulate_unit(spec, lot, 0, np.random.default_rng([2, unit]))
    ready = prepare(spec, made, silent, np.random.default_rng(3))
    f, sd = ready.summary.factor, ready.prior.sd
    return (posterior(f, sd, noise_scale(f, sd))[1] / sd)[: len(study.library.terms)]


@pytest.mark.parametrize(("passes", "known_noise"), [(1, True), (4, True), (4, False)])
def test_what_is_foreseen_is_what_units_that_repeat_the_campaign_find(study, passes, known_noise):
    """Of b0 only where the noise is given: a short run takes drift that it does not show for less."""
    foreseen = posterior_ratios(campaign_pass(study.specs[0]), passes)
    rule = NoiseRule("fixed", typical_noise(study.classes[0])) if known_noise else NoiseRule()
    fits = [_fitted(study, passes, unit, rule) for unit in range(1 if known_noise else 2)]
    found = np.sqrt(np.mean(np.square(fits), axis=0)) / foreseen
    held = np.array([known_noise or name != "b0" for name in study.library.names]) & (foreseen < 0.5)
    assert held.sum() >= 6
    np.testing.assert_allclose(found[held], 1.0, atol=0.1)


def test_a_rough_fixture_shortens_inputs_in_what_is_foreseen(study):
    """Nobody can tell it from a scale factor: of a rotation with the variance v half its square has v / 2."""
    spec, b1 = study.specs[0], study.library.names.index("b1")
    rough, fine = (
        campaign_pass(replace(spec, runs=spec.runs[:1], reference={"fixture": size})) for size in (1e-2, 1e-4)
    )
    alike = 1e-4 / math.sqrt(9)  # both tilts of each of the mounts
    sds = [posterior_ratios(campaign, 1)[b1] * campaign.prior_sd[b1] for campaign in (fine, rough)]
    assert sds[0] < 0.1 * alike < sds[1]


def test_error_of_a_mount_averages_over_the_repetitions_and_that_of_a_machine_stays(study):
    """In no noise: m_j by the rotation of each mount, b1 by the scale of the table's rate."""
    names = study.library.names
    campaign = campaign_pass(study.specs[0])
    sds = {n: posterior_ratios(campaign, n) * campaign.prior_sd for n in (1, 400, 40_000)}
    b1, m_j = names.index("b1"), names.index("m_j")
    assert sds[40_000][b1] ** -2 == pytest.approx(50e-6**-2 + campaign.prior_sd[b1] ** -2, rel=0.05)
    assert sds[400][m_j] == pytest.approx(sds[1][m_j] / 20.0, rel=0.02)
    known_bench = campaign_pass(replace(study.specs[0], reference={}))
    assert posterior_ratios(known_bench, 40_000)[b1] * known_bench.prior_sd[b1] < 1e-6
    assert sds[1][m_j] > 2.0 * (posterior_ratios(known_bench, 1) * known_bench.prior_sd)[m_j]


def test_drift_of_a_run_limits_a_longer_dwell_but_not_another_run(study):
    """A hundred times the dwell gains less than ten for the bias; a hundred passes gain ten."""
    spec = replace(study.specs[0], reference={})
    b0 = study.library.names.index("b0")
    long = tuple(replace(run, simulate={**run.simulate, "dwell": 3000.0, "rate": 0.01}) for run in spec.runs)
    once, again = (posterior_ratios(campaign_pass(spec), n)[b0] for n in (1, 100))
    longer = posterior_ratios(campaign_pass(replace(spec, runs=long)), 1)[b0]
    assert again == pytest.approx(once / 10.0, rel=0.05)
    assert longer > 3.0 * again


def test_part_of_a_campaign_tells_what_its_first_run_alone_does(study):
    spec = study.specs[0]
    whole, first = campaign_pass(spec), campaign_pass(replace(spec, runs=spec.runs[:1]))
    last = len(first.stop) - 1
    assert whole.runs[last : last + 2] == ("rates", "tumble")
    np.testing.assert_allclose(posterior_ratios(whole, 1, last), posterior_ratios(first, 1), rtol=1e-9)


def test_terms_of_one_lever_arm_are_told_together(tmp_path):
    """The one has no column of its own: it is in that of the other."""
    asked = LOTS.replace("gyroscope", "accelerometer")
    study = plan_of(tmp_path, asked.replace("asymmetry = 1", 'asymmetry = -1\nset = "extended"'))
    assert dict(study.specs[0].library.tied) == {"S_kk": "S_jj", "s_j": "S_ik"}
    terms = {term.name: term for term in hours(study).classes[0].terms}
    for one, other in (("S_kk", "S_jj"), ("s_j", "S_ik")):
        assert terms[one].once == terms[other].once < 0.9
        assert terms[one].limit == terms[other].limit


def test_what_is_known_grows_until_the_end_of_what_is_within_reach(study):
    times, runs, ratios = known(campaign_pass(study.specs[0]))
    assert len(runs) == len(times) < 1000
    assert (np.diff(times) > 0.0).all() and 0.97 * REACH < times[-1] <= REACH
    assert (np.diff(ratios, axis=0) <= 1e-9).all()
    (found,) = hours(study).classes
    first = [(ratios[:, j] > term.enough).sum() for j, term in enumerate(found.terms)]
    told = [(times[k], runs[k]) if k < len(times) else (np.inf, "") for k in first]
    assert [(term.seconds, term.run) for term in found.terms] == told
    assert found.told(REACH) > found.told(found.seconds) > 0
    assert sum(seconds for _, seconds in found.runs) == pytest.approx(found.seconds)


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_half_of_the_units_get_a_verdict_where_that_is_foreseen(size):
    """By the decision itself, on a constant in white noise."""
    rng, n, tries = np.random.default_rng(7), 50, 60
    constant = library("gyroscope", powers=1, asymmetry=-1)
    constant = replace(constant, terms=constant.terms[:1])
    theta = size * rng.standard_normal((tries, 1))
    ratio = float(ratio_enough(theta)[0])
    sigma = np.sqrt(n) * ratio / np.sqrt(1.0 - ratio**2)
    verdicts = []
    for truth in theta[:, 0].tolist():
        y = truth + sigma * rng.standard_normal(n)
        summary = replace(Summary.from_arrays(np.ones((n, 1)), y, ("b0",)), reach={"b0": 1.0})
        verdicts.append(select(summary, ScalePrior([1.0]), constant).terms[0].verdict)
    told = np.mean([one in ("needed", "not needed") for one in verdicts])
    assert told == pytest.approx(0.5, abs=4.0 * 0.5 / np.sqrt(tries))
