"""The whole method on the study that ships, and on small ones."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grounds import Grounds, explained
from page_reading import report_html, sentences, tree
from report_answers import wrong_sensors

import imubayes as ib
from imubayes.campaign import NoiseQuestion, Sampling, SensorSpec, Study, preparation
from imubayes.campaign.preparation import simulate_sensor
from imubayes.errors import StudyError
from imubayes.inference.mcmc import whitenings
from imubayes.inference.residuals import FAMILIES, SUSPECT, TESTS
from imubayes.reporting.chain_views import component_answer as answer
from imubayes.reporting.fit_views import fit_sentence
from imubayes.reporting.results import result_json
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.recordings import RunSpec, write_run
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.study import method

QUICKSTART = Path(__file__).parents[2] / "studies" / "quickstart.toml"
TUMBLE = {"profile": "tumble", "angles": 12, "planes": 3, "dwell": 10.0, "rate": 1.0}
TRUTH = {"b0": 0.03, "b1": 6e-4, "m_j": 5e-4}


@pytest.fixture(scope="module")
def quickstart():
    return ib.read_study(str(QUICKSTART))


@pytest.fixture(scope="module")
def result(quickstart):
    return method.run(replace(quickstart, compare=False))


def spec(**changes):
    """A tactical accelerometer on a short simulated tumble."""
    usual = SensorSpec(
        id="A",
        kind="accelerometer",
        sensor_class=ib.sensor("mems_tactical", kind="accelerometer"),
        library=ib.library("accelerometer", powers=2, asymmetry=-1),
        runs=(RunSpec("tumble", "tumble", simulate=TUMBLE),),
        truth=TRUTH,
    )
    return replace(usual, **changes)


def white_class():
    """The tactical class with all but no noise beside its white one."""
    usual, nearly = spec().sensor_class, (1e-12, 2e-12, 4e-12)
    return replace(usual, noise={**usual.noise, "B": nearly, "K": nearly})


def small(*sensors, seed=1, **sampling):
    """A study by the exact method, unless told otherwise, without the other methods beside it."""
    how = Sampling(**{"method": "exact", **sampling})
    return Study("small", seed, sensors or (spec(),), Path("small.toml"), "", how, compare=False)


@pytest.fixture(scope="module")
def plain():
    """What the small study says of its sensor."""
    return method.run(small()).sensors[0]


@pytest.fixture(scope="module")
def averaged():
    """The same over what the noise may be."""
    return method.run(small(method="auto")).sensors[0]


def test_quickstart_needs_its_true_terms_and_no_other(quickstart, result):
    truth, (sensor,) = quickstart.sensors[0].truth, result.sensors
    assert {t.name for t in sensor.selection.terms if t.verdict == "needed"} == set(truth)
    for term in sensor.selection.terms:
        assert abs(term.full_mean - truth.get(term.name, 0.0)) < 4.0 * term.full_sd, term.name
    assert all(check.fits for check in sensor.checks)


def test_numbers_and_answers_of_the_report_are_those_of_the_result(result):
    html, told = report_html(result), json.loads(result_json(result))
    assert explained(html, Grounds(told)) > 0.8
    assert [*wrong_sensors(sentences(tree(html)), told)] == []


def test_a_result_is_of_the_seed_and_the_sensors_before_it(plain):
    again, second = method.run(small(spec(), spec(id="B"))).sensors
    (other,) = method.run(small(seed=2)).sensors
    assert plain.selection.terms == again.selection.terms
    np.testing.assert_array_equal(plain.draws, again.draws)
    for one in (second, other):
        assert one.selection.terms[0].mean != plain.selection.terms[0].mean


def stated_noise(folder, share, truth=TRUTH):
    """A sensor on the small study's tumble, whose study states so many times its white noise."""
    white = white_class()
    runs = (RunSpec("tumble", "tumble", simulate=TUMBLE),)
    one = spec(runs=runs, sensor_class=white, bench_stated=True, truth=truth)
    write_run(simulate_sensor(one, 3, 0)[0][0], folder / "tumble.csv", kind=one.kind)
    noise = NoiseRule("fixed", Noise(share * typical_noise(white).N, 0.0, 0.0))
    recorded = (RunSpec("tumble", "tumble", folder / "tumble.csv", "tumble.csv", noise=noise),)
    return small(replace(one, truth={}, runs=recorded), seed=3)


@pytest.mark.parametrize("share", [0.01, 0.1, 1.0, 4.0])
def test_noise_that_is_stated_too_small_or_too_large_is_told_from_the_residuals(tmp_path, share):
    """A fit takes as many degrees of freedom as it has terms, however far rows scatter beyond the noise."""
    sensor = method.run(stated_noise(tmp_path, share)).sensors[0]
    (check,) = sensor.checks
    assert check.scale == pytest.approx(1.0 / share, rel=0.2)  # of 26 degrees of freedom
    assert check.misstated == pytest.approx(max(1.0, 1.0 / share), rel=0.1)
    assert check.fits == (share == 1.0)
    assert sensor.conditional == (share != 1.0)
    assert ("what the study states of tumble; state it anew" in fit_sentence(sensor)) == (share < 1.0)
    # beside a noise far too small everything stands out, and says nothing of bench and library
    assert sensor.absorbed is None and not sensor.misfit.found


@pytest.mark.parametrize("b3", [1e-6, 1e-3])
def test_a_noise_that_is_stated_right_is_not_blamed_for_what_the_library_lacks(tmp_path, b3):
    """Of a hundred microg, or of a tenth of g, which no function stands beside."""
    sensor = method.run(stated_noise(tmp_path, 1.0, {**TRUTH, "b3": b3})).sensors[0]
    assert (sensor.absorbed or sensor.misfit).found
    assert [check.misstated for check in sensor.checks] == [1.0]


def test_all_residual_tests_of_a_study_share_one_level():
    """What each may give in false alarms adds up to the level, however many sensors and runs there are."""
    found = method.run(small(spec(), spec(id="B")))
    every = [check for sensor in found.sensors for check in sensor.checks]
    by_runs = sum(TESTS * check.level for check in every)
    by_replicates = sum(2 * sensor.misfit.level * len(sensor.runs) for sensor in found.sensors)
    assert by_runs == pytest.approx(SUSPECT / FAMILIES) == pytest.approx(by_replicates)


def test_check_does_not_look_at_outputs(quickstart, monkeypatch):
    """The same words and numbers, whatever the sensor said."""
    plain = method.check(quickstart)[0]
    simulated = preparation.simulate_sensor

    def other_output(spec, seed, index):
        runs, truth = simulated(spec, seed, index)
        rng = np.random.default_rng(9)
        return tuple(replace(r, output=1e3 * rng.normal(size=len(r.output))) for r in runs), truth

    monkeypatch.setattr(preparation, "simulate_sensor", other_output)
    other = method.check(quickstart)[0]
    np.testing.assert_allclose(other.observability.ratio, plain.observability.ratio, rtol=1e-10)
    assert [g.terms for g in other.observability.groups] == [g.terms for g in plain.observability.groups]


def test_check_foretells_the_error_bars_of_the_run(quickstart, result):
    """The class's typical noise made these data, so what `check` promises is what `run` finds."""
    seen, selection = method.check(quickstart)[0].observability, result.sensors[0].selection
    for name, ratio, term in zip(seen.names, seen.ratio, selection.terms, strict=True):
        assert name == term.name
        assert term.full_sd / term.prior_sd == pytest.approx(ratio, rel=0.5), name


def test_a_study_s_own_prior_takes_the_place_of_the_class_s(plain):
    (own,) = method.run(small(spec(prior={"b0": 1.0}))).sensors
    by_name = {t.name: t for t in own.selection.terms}
    assert by_name["b0"].prior_sd == 1.0
    assert own.prior_source.endswith("; b0 from the study")
    assert all(t.prior_sd == by_name[t.name].prior_sd for t in plain.selection.terms if t.name != "b0")


def test_without_a_class_each_term_may_move_the_output_by_its_whole_range(monkeypatch):
    (run,) = method.runs_of(spec(), 1, 0)
    monkeypatch.setattr(method, "runs_of", lambda *_: (run,))
    (sensor,) = method.run(small(spec(sensor_class=None))).sensors
    swing = np.max(np.abs(run.output - run.inputs.channels["f_i"]))
    by_name = {t.name: t for t in sensor.selection.terms}
    assert by_name["b0"].prior_sd == pytest.approx(swing)
    assert by_name["b1"].prior_sd == pytest.approx(swing / 9.80665)
    assert "no class is named" in sensor.prior_source
    assert {"b1", "m_j"} <= {t.name for t in sensor.selection.terms if t.verdict == "needed"}


def test_estimated_noise_is_averaged_over_and_hardly_moves_what_a_long_test_says(plain, averaged):
    assert (plain.method, averaged.method) == ("plug-in", "collapsed")
    assert plain.chains is None
    assert "tumble" in averaged.method_reason
    assert averaged.chains.diagnostics.converged
    assert averaged.chains.names == tuple(t.name for t in averaged.selection.terms)
    for a, b, plug_in in zip(
        plain.selection.terms, averaged.selection.terms, averaged.selection.plug_in, strict=True
    ):
        assert plug_in == pytest.approx(a.inclusion, abs=1e-9)
        assert b.inclusion == pytest.approx(a.inclusion, abs=0.1), a.name
        assert abs(b.full_mean - a.full_mean) < 0.5 * a.full_sd, a.name


def test_chains_and_averaged_components_are_one_posterior(averaged):
    """The full library's moments come from the chains and, by another way, from sixteen exact whitenings."""
    theta = averaged.chains.theta.reshape(-1, len(averaged.selection.terms))
    for k, term in enumerate(averaged.selection.terms):
        error = term.full_sd * (4.0 / np.sqrt(len(theta)) + 1.0 / np.sqrt(16.0) * 0.5)
        assert abs(theta[:, k].mean() - term.full_mean) < error, term.name
        assert theta[:, k].std() == pytest.approx(term.full_sd, rel=0.15), term.name


def test_distrusted_run_leaves_its_noise_and_its_bench_errors_behind(monkeypatch):
    """Every dwell of the centrifuge is spoilt; the tumble was to have its noise, and the arm its radius."""
    arm = {"profile": "centrifuge", "levels": [1.0, 5.0], "dwell": 10.0, "rate": 1.0}
    like = NoiseRule("fixed", like="arm")
    wanted = spec(
        runs=(
            RunSpec("tumble", "tumble", simulate=TUMBLE, noise=like),
            RunSpec("arm", "centrifuge", simulate=arm),
        ),
        reference={"gravity": 1e-4, "radius": 1e-4},
        robust=True,
    )
    runs = method.runs_of(wanted, 1, 0)
    rng = np.random.default_rng(3)
    shocks = np.repeat(rng.choice([-1.0, 1.0], 24) * rng.uniform(0.5, 2.0, 24), 10)
    spoilt = replace(runs[1], output=runs[1].output + shocks)
    monkeypatch.setattr(method, "runs_of", lambda *_: (runs[0], spoilt))
    (sensor,) = method.run(small(wanted)).sensors
    assert [run.name for run in sensor.runs] == ["tumble"]
    assert sensor.runs[0].found.origin == "REML"
    assert [entry.extra.kind for entry in sensor.extras] == ["gravity"]
    assert any("arm" in note for note in sensor.runs[0].source.notes)


def test_errors_of_the_bench_become_columns_with_a_posterior(plain):
    (sensor,) = method.run(small(spec(reference={"gravity": 1e-3}))).sensors
    (gravity,) = sensor.extras
    assert gravity.extra.kind == "gravity"
    b1_prior = sensor.selection.terms[1].prior_sd * 9.80665
    # the test sees b1 g + dg alone: what is left of dg's prior is what b1's own leaves it
    assert gravity.sd == pytest.approx(1e-3 * b1_prior / np.hypot(b1_prior, 1e-3), rel=0.02)
    b1, known = (next(t for t in one.selection.terms if t.name == "b1") for one in (sensor, plain))
    assert b1.full_sd > 3.0 * known.full_sd
    assert b1.full_sd == pytest.approx(gravity.sd / 9.80665, rel=0.05)


def test_a_free_tumble_without_a_class_is_refused(monkeypatch):
    run = Run("hand", "free-tumble", Inputs(np.arange(5.0), {}, 1.0), np.ones((5, 3)), gravity=9.81)
    monkeypatch.setattr(method, "runs_of", lambda *_: (run,))
    with pytest.raises(StudyError, match="sensor 'A': several components in one case need a class"):
        method.run(small(spec(sensor_class=None)))


def test_noise_whose_density_cannot_be_followed_is_held_at_its_estimate(monkeypatch):
    """Walkers would go where nothing but the interpolation is likely."""
    monkeypatch.setattr(whitenings, "ORDERS", (7,))
    monkeypatch.setattr(whitenings, "_misleads", lambda *given: True)
    (sensor,) = method.run(small(method="collapsed")).sensors
    assert sensor.method == "plug-in" and sensor.chains is None
    assert "cannot be sampled: the likelihood of the noise of run tumble" in sensor.method_reason
    (chosen,) = method.run(small(method="auto", budget=60.0)).sensors
    assert chosen.choice.rung == "averaged"


def test_clipped_centrifuge_gives_the_true_coefficients_of_what_is_left(tmp_path):
    arm = {"profile": "centrifuge", "levels": [1.0, 5.0, 20.0], "dwell": 5.0, "rate": 10.0}
    runs = (RunSpec("arm", "centrifuge", simulate=arm),)
    one = spec(runs=runs, truth={"b0": 0.02, "b1": 3e-4})
    (run,), _ = simulate_sensor(one, 1, 0)
    write_run(replace(run, output=np.clip(run.output, -177.0, 177.0)), tmp_path / "arm.csv", kind=one.kind)
    recorded = replace(one, truth={}, runs=(RunSpec("arm", "centrifuge", tmp_path / "arm.csv", "arm.csv"),))
    (sensor,) = method.run(small(recorded)).sensors
    assert sensor.samples < run.samples and all(check.fits for check in sensor.checks)
    for term in sensor.selection.terms:
        assert abs(term.full_mean - one.truth.get(term.name, 0.0)) < 4.0 * term.full_sd, term.name
    assert any("arm: output is saturated at" in text for text in answer(sensor))
    (checked,) = method.check(small(recorded))
    assert "samples are left out" in checked.notes[0]


def test_a_counted_log_beside_a_centrifuge_shows_its_processes_in_samples(tmp_path):
    arm = {"profile": "centrifuge", "levels": [1.0, 5.0, 20.0], "dwell": 5.0, "rate": 10.0}
    log = {"profile": "static", "duration": 100.0, "rate": 10.0}
    simulated = spec(
        runs=(RunSpec("arm", "centrifuge", simulate=arm), RunSpec("log", "static", simulate=log))
    )
    runs, _ = simulate_sensor(simulated, 1, 0)
    step, specs = 3.0 * float(np.std(runs[1].output)), []
    for run in runs:  # of the log so many increments of velocity as its counter has
        mean = run.output.mean()
        counted = np.diff(np.floor(np.cumsum(run.output - mean) / step) * step, prepend=0.0)
        output = mean + counted if run.name == "log" else run.output
        write_run(replace(run, output=output), tmp_path / f"{run.name}.csv", kind="accelerometer")
        specs.append(RunSpec(run.name, run.procedure, tmp_path / f"{run.name}.csv", f"{run.name}.csv"))
    asked = small(replace(simulated, truth={}, runs=tuple(specs)))
    (sensor,) = method.run(replace(asked, noise=NoiseQuestion(candidates=("B",)))).sensors
    assert [entry.extra.name for entry in sensor.extras] == ["radius"]
    assert sensor.prior_source.endswith("radius by the catalogue, since the study says nothing of its bench")
    assert any("samples enter as means" in note for note in sensor.runs[1].source.notes)
    (found,) = sensor.processes
    assert found.samples == runs[1].samples


def test_noise_rules_are_obeyed_and_named(plain):
    given = Noise(6e-4, 4e-4, 1e-6)
    origins = {plain.runs[0].found.origin: plain.runs[0].noise}
    white = white_class()
    for rule in (NoiseRule("white"), NoiseRule("fixed", given)):
        runs = (RunSpec("tumble", "tumble", simulate=TUMBLE, noise=rule),)
        (run,) = method.run(small(spec(runs=runs, sensor_class=white))).sensors[0].runs
        origins[run.found.origin] = run.noise
    assert set(origins) == {"REML", "white", "given"}
    assert origins["given"] == given
    assert origins["white"].B == origins["white"].K == 0.0 < origins["white"].N
