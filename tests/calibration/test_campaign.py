"""An industrial MEMS on three-plane tumble and twelve-mount centrifuge, with the noise of its class.

The documented example of why noise must be coloured from the first day: the same 32,400 rows, whitened by
their estimated noise, keep no false term; treated as white, they always keep some and are many sd off.
"""

import pytest

import imubayes as ib

SEEDS = range(20)

# a bias of 12 mg and effects of one to two typical values of the class, SI; every other term is zero
UG = 9.80665e-6
TRUTH = {
    "b0": 12_000 * UG,
    "b1": 1.5e-3,
    "b2": 90e-6 / 9.80665,
    "b1p": 120e-6,
    "m_j": 900e-6,
    "m_k": -700e-6,
    "c_ij": 50e-6 / 9.80665,
    "S_ij": 2e-4,
}


def campaign(seed, rule):
    sensor, library = ib.sensor("mems_industrial", kind="accelerometer"), ib.library("accelerometer")
    runs = ib.simulate(
        sensor, [ib.tumble(angles=24, planes=3), ib.centrifuge([1, 5, 20])], seed=seed, truth=TRUTH
    )
    assert sum(len(run.inputs) for run in runs) >= 30_000
    rules = {run.name: ib.NoiseRule(rule) for run in runs}
    return ib.select(ib.summarize(runs, library, sensor=sensor, rules=rules), ib.prior(sensor, library))


def false_keeps(selection):
    return [t.name for t in selection.terms if t.verdict == "needed" and t.name not in TRUTH]


def worst_pull(selection):
    return max(abs(t.full_mean - TRUTH.get(t.name, 0.0)) / t.full_sd for t in selection.terms)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_coloured_noise_keeps_no_zero_term_and_every_strong_one(seed):
    selection = campaign(seed, "estimate")
    assert false_keeps(selection) == []
    assert {t.name for t in selection.terms if t.verdict == "needed"} == set(TRUTH)
    for term in selection.terms:
        assert abs(term.mean - TRUTH.get(term.name, 0.0)) < 4.0 * max(term.sd, term.full_sd), term.name
    assert worst_pull(selection) < 4.0


@pytest.mark.slow
def test_white_noise_treatment_keeps_zero_terms_and_misses_the_truth():
    selections = [campaign(seed, "white") for seed in (0, 1, 2, 3, 4)]
    assert all(false_keeps(s) for s in selections)
    assert all(worst_pull(s) > 4.0 for s in selections)
