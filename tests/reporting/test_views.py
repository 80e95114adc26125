"""Numbers of a report by a second route: cases, chains, residuals, sessions, noise."""

import math
import tomllib
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
from block_readings import panels, rows
from results_found import (
    MG,
    UG,
    cased,
    judged_result,
    recovered,
    repeatability,
    sampled_result,
    sensor_result,
)
from scipy.stats import multivariate_normal

from imubayes.algebra.factor import factor_of
from imubayes.inference.allan import AllanFit, allan_curve
from imubayes.inference.free_functions import lacked
from imubayes.reporting.case_views import CANNOT, KNOWN, case_section, pooled_verdict
from imubayes.reporting.chain_views import exact_evidence, own_errors
from imubayes.reporting.fit_views import MOST_DEPENDENCES, misfit_sections, option_of
from imubayes.reporting.noise_views import noise_blocks, published_processes
from imubayes.reporting.population_views import largest_pull
from imubayes.reporting.results import published_result
from imubayes.reporting.rounding import NOISE
from imubayes.reporting.rows import noise_cells, noise_draws, noise_floor
from imubayes.selection.noise_choice import NoiseChoice, ProcessSize
from imubayes.selection.verdicts import EQUAL, UNSEEN
from imubayes.sensors.noise import allan_variance
from imubayes.sensors.terms import library
from imubayes.units import factor


@pytest.mark.parametrize(("what", "width"), [("gravity", 1), ("rest", 3), ("closure", 2), ("turn", 1)])
def test_errors_are_root_mean_squares_in_the_printed_unit(what, width):
    """Of a closure the two directions make one angle; of the others each number counts."""
    one = recovered(what, width=width)
    study = cased(one)
    row = rows([case_section("U0", "case1", study.sensors, EQUAL)])[0]
    unit = {"mg": MG, "deg/s": math.pi / 180.0, "deg": math.pi / 180.0}[KNOWN[what].printed]
    squares = np.sum(one.after**2) / (30 if what == "closure" else 30 * width)
    assert float(row[4].replace(" ×10⁻", "e-")) == pytest.approx(math.sqrt(squares) / unit, rel=0.05)
    (record,) = published_result(study)["cases"][0]["recovered"]
    assert record["rms"]["after"] == pytest.approx(math.sqrt(squares), rel=1e-12)
    assert (record["within_2_sd"], record["of"]) == (one.inside, 30 * width)
    assert row[-1] == f"{one.inside} of {30 * width}"


@pytest.mark.parametrize("inclusion", [0.0, 0.3, 0.9, 1.0])
def test_what_no_component_can_tell_is_not_told_by_all_and_no_answer_is_against_each(inclusion):
    assert pooled_verdict(inclusion, UNSEEN) == CANNOT
    assert pooled_verdict(inclusion, (*UNSEEN, "undecided"), EQUAL) != CANNOT
    assert pooled_verdict(inclusion, (*UNSEEN, "not needed", "not needed")) != "needed"
    assert pooled_verdict(inclusion, (*UNSEEN, "needed", "undecided")) != "not needed"


@pytest.mark.parametrize(("id", "listed"), [("imu.ay", ["gravity", "tilt_j.ay"]), ("alone", None)])
def test_a_component_lists_the_bench_and_its_own_errors(id, listed):
    names = ["gravity", "tilt_j.ax", "tilt_j.ay", "turn_on.log.gz"]
    extras = [
        SimpleNamespace(extra=SimpleNamespace(name=name, kind=name.partition(".")[0])) for name in names
    ]
    found = own_errors(SimpleNamespace(id=id, extras=extras))
    assert [entry.extra.name for entry in found] == (listed or names)


def test_exact_evidence_is_the_density_of_the_data_with_coefficients_and_noise_integrated():
    sensor, rng = sampled_result(), np.random.default_rng(8)
    columns = (*sensor.selection.columns, *(entry.extra.name for entry in sensor.extras))
    sd = np.array([*(t.prior_sd for t in sensor.selection.terms), *(e.extra.sd for e in sensor.extras)])
    runs, log_density = [], []
    X = [0.5 * rng.standard_normal((40, len(sd))) / sd for _ in sensor.runs]
    L = [np.tril(0.2 * rng.standard_normal((40, 40))) + np.eye(40) for _ in sensor.runs]
    y = np.concatenate([rows @ (sd * rng.standard_normal(len(sd))) for rows in X])
    for k, run in enumerate(sensor.runs):
        white = np.linalg.solve(L[k], np.column_stack((X[k], y[40 * k : 40 * k + 40])))
        log_det = 2.0 * float(np.sum(np.log(np.abs(np.diag(L[k])))))
        made = factor_of(white[:, :-1], white[:, -1], columns, log_det=log_det)
        runs.append(replace(run, factor=made))
    whole, noise = np.concatenate(X), np.zeros((80, 80))
    noise[:40, :40], noise[40:, 40:] = L[0] @ L[0].T, L[1] @ L[1].T
    covariance = noise + (whole * sd**2) @ whole.T
    log_density = multivariate_normal(np.zeros(80), covariance).logpdf(y)
    assert exact_evidence(replace(sensor, runs=tuple(runs))) == pytest.approx(log_density, abs=1e-8)


def test_component_of_a_triad_has_no_evidence_of_its_own() -> None:
    sensor = sampled_result()
    own = tuple(f"ay.{name}" for name in sensor.selection.columns)
    assert exact_evidence(replace(sensor, selection=replace(sensor.selection, columns=own))) is None


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


def test_largest_pull_is_the_largest_difference_over_its_sd() -> None:
    one = repeatability("b0", units=4)
    by_hand = {
        (u, s, r): abs(one.mean[u, s] - one.mean[u, r]) / math.hypot(one.sd[u, s], one.sd[u, r])
        for u in range(4)
        for s in range(3)
        for r in range(s + 1, 3)
        if math.isfinite(one.mean[u, s] + one.mean[u, r])
    }
    (u, s, r), size = max(by_hand.items(), key=lambda entry: entry[1])
    pull, where = largest_pull(one)
    assert pull == pytest.approx(size, rel=1e-12)
    assert where == f"{one.units[u]}, {one.sessions[s]} to {one.sessions[r]}"


def test_noise_floor_is_the_lowest_allan_deviation() -> None:
    sensor = sensor_result()
    tau = np.geomspace(1.0, 2880.0, 5000)
    lowest = min(float(np.sqrt(allan_variance(asdict(run.noise), tau).min())) for run in sensor.runs)
    assert float(noise_floor(sensor).value) == pytest.approx(lowest / UG, rel=0.05)


def test_noise_of_the_chains_is_printed_by_their_mean_and_sd() -> None:
    sensor = sampled_result()
    run, chains = sensor.runs[0], sensor.chains
    (N, _), _, (K, is_limit) = noise_cells(run, sensor.kind, chains)
    draws = chains.noise[:, :, 0, 0] / UG
    assert noise_draws(run, chains) is not None and is_limit
    assert float(N.value) == pytest.approx(draws.mean(), abs=0.05)
    assert float(N.sd) == pytest.approx(draws.std(), rel=0.05)
    # the limit is rounded up: 95 % of the draws are below it
    below = chains.noise[:, :, 0, 2] / UG < float(K.value)
    assert 0.95 <= below.mean() < 0.97
    shared = replace(sensor.runs[1], found=replace(sensor.runs[1].found, run="tumble"))
    assert noise_cells(shared, sensor.kind, chains) == noise_cells(run, sensor.kind, chains)


ARW = factor("deg/sqrt(h)", like="rad/s/sqrt(Hz)")
DPH = factor("deg/h", like="rad/s")


def size(name, mean, verdict, inclusion, partners=()):
    return ProcessSize(
        name, inclusion, mean, 0.1 * abs(mean), 0.8 * mean, mean, 1.2 * mean, 1.2 * abs(mean),
        math.nan if name in ("N", "tau") else 2.0 * abs(mean), verdict, "because", partners,
    )  # fmt: skip


@pytest.fixture
def gyro():
    noise = {"N": 0.15 * ARW, "B": 2.0 * DPH}
    choice = NoiseChoice(
        run="quiet",
        sizes=(
            size("N", noise["N"], "needed", 1.0),
            size("B", noise["B"], "needed", 0.999),
            size("K", 1e-8, "inseparable", 0.6, ("R",)),
            size("Q", 1e-6, "not needed", 0.01),
            size("R", 1e-10, "inseparable", 0.4, ("K",)),
        ),
        sets=((("B",), 0.7), (("B", "K"), 0.3)),
        noise=noise,
        prior="class x",
        samples=1000,
        rows=1000,
        draws=np.zeros((1, 7)),
    )
    y = noise["N"] * np.random.default_rng(1).normal(size=1000)
    curve = allan_curve(y, np.arange(1000.0), 1.0, noise)
    fit = AllanFit(("N", "B"), (0.151 * ARW, 1.9 * DPH), (0.01, 0.1), 10.0, 9)
    return SimpleNamespace(
        kind="gyroscope", runs=(), chains=None, processes=(replace(choice, curve=curve, fit=fit),)
    )


def test_rows_hold_both_routes_and_limits_of_what_is_not_there(gyro):
    blocks = list(noise_blocks(gyro, "s1", drawn=True))
    found = {row[0]: row[3:7] for row in rows(blocks)}
    size, unit, allan, _ = found["B"]
    assert (size, unit, allan) == ("2.00 ± 0.20", "°/h", "1.90 ± 0.19")
    assert found["Q"][0].startswith("below ") and "±" not in found["Q"][0] and found["Q"][2] == ""
    assert found["N"][3] == "" and found["K"][3] != ""
    (panel,) = panels(blocks)
    assert "deg" not in panel.svg and "°/h" in panel.svg


def test_published_processes_are_in_si_and_name_both_units(gyro):
    record = published_processes(gyro)["quiet"]
    assert record["identified"] == ("N", "B")
    assert record["processes"]["B"]["mean"] == pytest.approx(2.0 * DPH)
    assert record["processes"]["B"]["printed_unit"] == "deg/h"
    assert record["allan"]["values"]["N"] == pytest.approx(0.151 * ARW)


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_every_printed_unit_measures_what_its_si_unit_does(kind):
    for printed, si in NOISE[kind].values():
        assert factor(printed, like="" if si == "rad" else si) > 0.0


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
@pytest.mark.parametrize(
    "own", [{"powers": 1, "asymmetry": -1}, {"powers": 3, "temperature": 2, "rate_of": ()}]
)
def test_options_of_a_term_that_was_lacking_give_a_library_that_has_it(kind, own):
    lib = library(kind, **own)
    further = set(lacked(lib).names)
    assert {"S_ii", "b0*dT"} <= further and not further & set(lib.names)
    for name in further:
        options = tomllib.loads(option_of(name).replace(" and ", "\n"))
        assert name in library(kind, **{**own, "temperature": 1, **options}).names
