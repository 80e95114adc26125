"""What the library lacks is found where it is, and nothing is found where nothing is lacking."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import imubayes as ib
from imubayes.inference.linear import linear_of
from imubayes.inference.misfit import find_misfit
from imubayes.inference.prior import class_sd
from imubayes.inference.residuals import SUSPECT
from imubayes.sensors.catalogue import draw_unit
from imubayes.sensors.noise import Noise, NoiseRule

TACTICAL = ib.sensor("mems_tactical", kind="accelerometer")
TUMBLE = ib.tumble(dwell=10.0)
ARM = ib.centrifuge([1, 5, 20], mounts=8, dwell=10.0)
CHAMBER = ib.thermal(
    [253.0, 293.0, 333.0, 293.0, 253.0], positions=4, dwell=30.0, soak=600.0, ramp=1.0 / 30.0, rate=0.5
)


def misfit_of(runs, lib, *, entry=TACTICAL, rules=None, seed=1, share=1):
    rows = [linear_of(run, lib) for run in runs]
    summary = ib.summarize(runs, lib, sensor=entry, rules=rules)
    channels = [run.inputs.channels for run in runs]
    rng = np.random.default_rng(seed)
    return find_misfit(rows, channels, summary, class_sd(entry, lib), rng=rng, share=share)


def lacking(truth, plan, lib, seed=5):
    return misfit_of(ib.simulate(TACTICAL, [TUMBLE, plan], seed=seed, truth=truth), lib)


def test_missing_asymmetry_shows_in_the_own_input_with_its_shape():
    lib = ib.library("accelerometer", powers=3, asymmetry=-1)
    term, *found = lacking({"b0": 0.01, "b1p": 2e-4}, ARM, lib).found
    assert [(one.run, one.input) for one in (term, found[0])] == [("", "b1p"), ("centrifuge", "f_i")]
    # |f| less what a cubic takes of it is lowest at zero, and bends up to both sides of it
    x, mean = found[0].x, found[0].mean
    near, far = np.abs(x) < 0.2 * np.max(x), np.abs(np.abs(x) - 0.5 * np.max(x)) < 0.3 * np.max(x)
    assert mean[near].min() < mean[far].mean()


def test_missing_square_of_temperature_shows_in_temperature():
    lib = ib.library("accelerometer", temperature=1)
    term, *found = lacking({"b0": 0.01, "b0*T": 3e-4, "b0*T2": 5e-6}, CHAMBER, lib).found
    assert [(one.run, one.input) for one in (term, found[0])] == [("", "b0*T2"), ("thermal", "T")]
    # the parabola 5e-6 (T - T0)^2 less its straight line, averaged over the record: two routes to its size
    T = CHAMBER.inputs.channels["T"]
    parabola = 5e-6 * (T - T.mean()) ** 2
    left = parabola - np.polyval(np.polyfit(T, parabola, 1), T)
    assert found[0].size == pytest.approx(left.std(), rel=0.2)


def test_nothing_is_found_in_an_output_whose_steps_are_so_coarse_that_it_does_not_change():
    # a gyroscope that a tumble does not turn: every sample reads the same
    gyroscope = ib.sensor("fog_tactical", kind="gyroscope")
    (run,) = ib.simulate(gyroscope, [TUMBLE], seed=5, truth={})
    still = replace(run, output=np.zeros(len(run.output)))
    assert misfit_of([still], ib.library("gyroscope"), entry=gyroscope).found == ()


def test_a_library_that_does_nothing_in_a_run_by_its_prior_is_no_fault():
    gyroscope, lib = ib.sensor("mems_tactical", kind="gyroscope"), ib.library("gyroscope", powers=1)
    (run,) = ib.simulate(gyroscope, [TUMBLE], seed=5, truth={})
    rows, summary = [linear_of(run, lib)], ib.summarize([run], lib, sensor=gyroscope)
    slight, rng = np.full(len(lib.names), 1e-12), np.random.default_rng(1)
    assert find_misfit(rows, [run.inputs.channels], summary, slight, rng=rng).found == ()


def with_hysteresis(size):
    """Chamber run of a sensor whose bias lags behind the temperature by a tenth of its range."""
    (run,) = ib.simulate(TACTICAL, [CHAMBER], seed=5, truth={"b0": 0.01, "b0*T": 3e-4})
    T = run.inputs.channels["T"]
    dragged, lag = T[0], np.empty(len(T))
    for k, value in enumerate(T):
        dragged = min(max(dragged, value - 8.0), value + 8.0)
        lag[k] = (value - dragged) / 8.0
    return replace(run, output=run.output + size * lag)


def test_hysteresis_shows_between_heating_and_cooling():
    misfit = misfit_of([with_hysteresis(3e-3)], ib.library("accelerometer", temperature=2, rate_of=()))
    worst = misfit.found[0]
    assert worst.input == "hysteresis of T"
    assert "something the library does not contain" in misfit.text
    assert "T between heating and cooling in run thermal (p " in misfit.text
    # what heating adds over cooling in the middle is the loop's width
    sides = [(np.abs(worst.x - 293.0) < 5.0) & (worst.branch == side) for side in (1.0, -1.0)]
    up, down = (worst.mean[side].mean() for side in sides)
    sd = np.hypot(*(worst.sd[side].mean() for side in sides))
    assert sd < 5e-4 and up - down == pytest.approx(6e-3, abs=4.0 * sd)


def test_what_is_missing_is_found_among_the_tests_of_a_large_study_and_chance_is_not():
    lib = ib.library("accelerometer", temperature=2, rate_of=())
    alone, among = (misfit_of([with_hysteresis(1e-2)], lib, share=share) for share in (1, 100))
    assert among.found[0].input == alone.found[0].input == "hysteresis of T"
    for one, other in zip(alone.dependences, among.dependences, strict=True):
        assert other.p == pytest.approx(min(1.0, 100.0 * one.p), rel=1e-9) or one.p == 1.0
    assert all(one.p < SUSPECT for one in among.found)
    assert among.level == pytest.approx(alone.level / 100.0)


def test_hysteresis_shows_beside_a_term_of_the_rate_that_cannot_mend_it():
    misfit = misfit_of([with_hysteresis(3e-3)], ib.library("accelerometer", temperature=2))
    assert misfit.found[0].input == "hysteresis of T"


def test_sensor_without_hysteresis_has_the_same_residuals_on_both_branches():
    assert not misfit_of([with_hysteresis(0.0)], ib.library("accelerometer", temperature=2)).found


def rate_steps(truth, seed):
    """Steps of a rate table, input axis up, in white noise that is known: a classical lack-of-fit test."""
    gyro = ib.sensor("mems_tactical", kind="gyroscope")
    levels = [-3.0, -1.0, -0.3, 0.4, 1.0, 3.0]
    plan = ib.rate_table(levels, mounts=1, dwell=20.0, rate=1.0, settle=2.0, latitude=None)
    noise = Noise(1e-4, 0.0, 0.0)
    (run,) = ib.simulate(gyro, [plan], seed=seed, truth=truth, noise=noise)
    lib = ib.library("gyroscope", powers=1, asymmetry=-1)
    rules = {run.name: NoiseRule("fixed", noise)}
    return run, misfit_of([run], lib, entry=gyro, rules=rules, seed=seed)


@pytest.mark.parametrize("seed", range(4))
def test_p_value_is_that_of_the_classical_lack_of_fit_test(seed):
    run, misfit = rate_steps({"b0": 1e-3, "b1": 1e-3, "b2": 2e-5}, seed)
    w, y = run.inputs.channels["w_i"], run.output - run.inputs.channels["w_i"]
    levels = np.unique(w)
    pure = sum(float(np.sum((y[w == level] - y[w == level].mean()) ** 2)) for level in levels)
    line = float(np.sum((y - np.polyval(np.polyfit(w, y, 1), w)) ** 2))
    more, dof = len(levels) - 2, len(w) - len(levels)
    p = stats.f.sf((line - pure) / more / (pure / dof), more, dof)
    (one,) = (d for d in misfit.dependences if d.input == "w_i")
    assert one.p == pytest.approx(min(1.0, len(misfit.dependences) * p), rel=1e-8)
    assert one.share == pytest.approx((line - pure) / line, rel=1e-8)


@pytest.mark.parametrize("levels", [(0.3, 1.0, 3.0, 5.0), (0.3, 1.0, 2.0, 3.0, 4.0, 5.0)])
def test_few_means_show_a_power_that_is_missing_and_nothing_where_none_is(levels):
    # a free function would take nearly all of 8 or 12 levels
    gyro, lib = ib.sensor("mems_tactical", kind="gyroscope"), ib.library("gyroscope", powers=1, asymmetry=-1)
    rates = [*(-np.array(levels[::-1])), *levels]
    plan = ib.rate_table(rates, mounts=1, dwell=10.0, rate=0.1, settle=2.0, latitude=None)

    def found(seed, **lack):
        truth = {"b0": 1e-3, "b1": 1e-3, **lack}
        return misfit_of(ib.simulate(gyro, [plan], seed=seed, truth=truth), lib, entry=gyro).found

    for lack in ({"b0p": 1e-2}, {"b1p": 3e-3}, {"b2": 1e-3}, {"b3": 1e-3}):
        assert [(one.where, one.p < 1e-4) for one in found(3, **lack)] == [
            (f"{next(iter(lack))} over all runs", True)
        ]
    assert sum(bool(found(seed)) for seed in range(20)) < 3


def slow_and_fast(seed, b2):
    """Two rates each in two runs: every run by itself is a straight line."""
    gyro, lib = ib.sensor("mems_tactical", kind="gyroscope"), ib.library("gyroscope", powers=1, asymmetry=-1)
    tables = {"slow": [-0.2, 0.2], "fast": [1.0, 3.0]}
    plans = [
        replace(ib.rate_table(rates, mounts=1, dwell=20.0, rate=1.0, settle=2.0, latitude=None), name=name)
        for name, rates in tables.items()
    ]
    noise, truth = Noise(1e-4, 0.0, 0.0), {"b0": 1e-3, "b1": 1e-3, "b2": b2}
    runs = ib.simulate(gyro, plans, seed=seed, truth=truth, noise=noise)
    return runs, misfit_of(runs, lib, entry=gyro, rules={run.name: NoiseRule("fixed", noise) for run in runs})


def welch(runs):
    """p-value of a parabola beside a line through all samples; each run's own line tells its noise."""
    w, y, sd = [], [], []
    for run in runs:
        x, output = run.inputs.channels["w_i"], run.output - run.inputs.channels["w_i"]
        left = output - np.polyval(np.polyfit(x, output, 1), x)
        sd.append(np.full(len(x), np.sqrt(left @ left / (len(x) - 2))))
        w.append(x)
        y.append(output)
    w, y, sd = map(np.concatenate, (w, y, sd))
    X = np.stack((np.ones(len(w)), w, w**2), axis=1)
    gain = np.linalg.pinv(X / sd[:, None])[-1] / sd
    parts = [float(np.sum((gain * sd)[w < 0.5] ** 2)), float(np.sum((gain * sd)[w > 0.5] ** 2))]
    dof = sum(parts) ** 2 / sum(part**2 / 38 for part in parts)
    return 2.0 * stats.t.sf(abs(gain @ y) / np.sqrt(sum(parts)), dof)


@pytest.mark.parametrize("seed", range(4))
def test_power_that_no_run_shows_alone_is_found_in_all_of_them(seed):
    runs, misfit = slow_and_fast(seed, 6e-5)
    (found,) = misfit.found
    assert (found.run, found.input) in {("", "b2"), ("", "b2p"), ("", "b3"), ("", "b3p")}
    assert f"it shows in {found.input} over all runs (p = " in misfit.text
    assert "w_i" not in {d.input for d in misfit.dependences}
    (one,) = (d for d in misfit.dependences if d.input == "b2")
    assert np.log(one.p / len(misfit.dependences)) == pytest.approx(np.log(welch(runs)), rel=0.05)


def test_powers_over_all_runs_raise_few_false_alarms():
    """At one in a hundred of 60 sensors, 5 or more have a probability of 4e-4."""
    assert sum(bool(slow_and_fast(seed, 0.0)[1].found) for seed in range(60)) < 5


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_the_rows_exclude_hides_nothing(seed):
    # ln B is open by itself; where it were far above what the rows show, anything could be chance
    gyro, lib = ib.sensor("mems_tactical", kind="gyroscope"), ib.library("gyroscope", powers=1, asymmetry=-1)
    plan = ib.rate_table(
        [-3.0, -1.0, -0.3, 0.4, 1.0, 3.0], mounts=1, dwell=20.0, rate=1.0, settle=2.0, latitude=None
    )
    noise = Noise(5e-5, 2e-6, 1e-9)
    runs = ib.simulate(gyro, [plan], seed=seed, truth={"b0": 1e-3, "b1p": 1e-4}, noise=noise)
    known = {run.name: NoiseRule("fixed", noise) for run in runs}
    estimated, given = (misfit_of(runs, lib, entry=gyro, rules=rules).found[0] for rules in ({}, known))
    assert given.p < 1e-30 and estimated.p < given.p**0.35


def test_p_values_of_noise_alone_are_uniform_where_the_noise_is_known():
    found = [rate_steps({"b0": 1e-3}, seed)[1] for seed in range(60)]
    p = [d.p / len(m.dependences) for m in found for d in m.dependences if d.input == "w_i" and d.p < 1.0]
    # corrected p-values stop at 1: below, they are uniform between 0 and one over the number of looks
    looks = len(found[0].dependences)
    assert stats.binomtest(len(p), 60, 1.0 / looks).pvalue > 1e-4
    assert stats.kstest(np.array(p) * looks, "uniform").pvalue > 1e-4


def test_predictive_p_values_of_the_true_model_are_not_extreme_and_a_shifted_run_is():
    lib = ib.library("accelerometer")
    noise = Noise(6e-4, 2e-4, 1e-6)
    runs = ib.simulate(TACTICAL, [TUMBLE, ARM], seed=3, truth={"b0": 0.01}, noise=noise)
    rules = {run.name: NoiseRule("fixed", noise) for run in runs}
    assert all(0.001 < p < 0.999 for p in misfit_of(runs, lib, rules=rules).predictive_p.values())
    shifted = (runs[0], replace(runs[1], output=runs[1].output + 0.02))
    assert min(misfit_of(shifted, lib, rules=rules).predictive_p.values()) < 1e-6


def well_specified(seed, runs=2):
    """Misfit of a unit drawn from its class whose library holds all there is."""
    rng = np.random.default_rng([11, seed])
    kind = ("accelerometer", "gyroscope")[seed % 2]
    names = {
        "accelerometer": ("mems_tactical", "mems_industrial"),
        "gyroscope": ("mems_tactical", "fog_tactical"),
    }
    entry = ib.sensor(names[kind][seed // 2 % 2], kind=kind)
    if kind == "accelerometer":
        plans, lib = [ARM, CHAMBER], ib.library(kind, temperature=2)
    else:
        table = ib.rate_table([-3.0, -1.0, -0.3, 0.3, 1.0, 3.0], dwell=10.0)
        plans, lib = [table, CHAMBER], ib.library(kind, set="extended", temperature=2)
    made = ib.simulate(entry, plans[:runs], seed=rng, truth=draw_unit(entry, lib, rng))
    return misfit_of(made, lib, entry=entry, seed=seed)


def test_few_false_alarms():
    """At one in a hundred, 3 or more of 8 have a probability of 5e-5."""
    alarms = sum(bool(well_specified(seed, runs=1).found) for seed in range(8))
    assert alarms < 3


@pytest.mark.slow
def test_false_alarms_are_no_more_than_one_sensor_in_a_hundred():
    """Of 300 sensors 3 are expected, and no more than 9 within 4 standard errors."""
    number = 300
    alarms = sum(bool(well_specified(seed).found) for seed in range(number))
    expected = SUSPECT * number
    assert alarms <= expected + 4.0 * np.sqrt(expected)
