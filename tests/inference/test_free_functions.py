"""What the library lacks, beside it: a fourth power that is missing no longer passes for a second one."""

from dataclasses import replace

import made
import numpy as np
import pytest
from benches import decided_terms

from imubayes.campaign import SensorSpec, prepared
from imubayes.campaign.prepared import summarized
from imubayes.errors import ConvergenceError
from imubayes.inference.dwells import whitened_factor
from imubayes.inference.free_functions import functions_of
from imubayes.inference.linear import linear_of, reach_of
from imubayes.ladder.problem import problem_of
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.simulate import plan_run, simulate, synthesise
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library
from imubayes.study import method
from imubayes.study.schema import read_study

STUDY = """
[study]
title = "a power is missing"
[[sensor]]
id = "A-1"
class = "mems_tactical"
kind = "accelerometer"
library = { powers = 3, asymmetry = -1 }
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 24, planes = 3, dwell = "10 s", rate = "2 Hz" }
[[sensor.run]]
name = "centrifuge"
procedure = "centrifuge"
simulate = { levels = ["2 g", "5 g", "10 g", "15 g", "20 g"], dwell = "10 s", rate = "2 Hz" }
"""
TRUTH = {"b0": 0.0147, "b1": 3.1e-4, "m_j": 3.5e-4, "c_ij": 2.5e-6}


HEATED = """
[study]
title = "a square of the temperature is missing"
[[sensor]]
id = "G-1"
class = "mems_tactical"
kind = "gyroscope"
library = { powers = 1, asymmetry = -1, temperature = 1 }
[[sensor.run]]
name = "table"
procedure = "rate-table"
simulate = { rates = ["-100 deg/s", "-20 deg/s", "50 deg/s", "200 deg/s"], dwell = "10 s", rate = "2 Hz" }
[[sensor.run]]
name = "chamber"
procedure = "thermal"
simulate = { temperatures = ["-20 degC", "0 degC", "30 degC", "60 degC"], soak = "10 min", rate = "0.2 Hz" }
"""


def measured(folder, truth, noise=None, study=STUDY):
    """The study's sensor, and its runs as a sensor of this truth would give them."""
    path = folder / "study.toml"
    path.write_text(study)
    (spec,) = read_study(path).sensors
    assert spec.sensor_class is not None
    plans = [plan_run(run) for run in spec.runs]
    return spec, simulate(spec.sensor_class, plans, seed=2, truth=truth, noise=noise)


def answered(folder, more, *, doubted):
    return decided_terms(problem_of(*measured(folder, {**TRUTH, **more})), doubted=doubted)


def test_a_missing_power_passes_for_no_term_and_error_bars_hold_the_truth(tmp_path):
    more = {"b4": 5e-8 / 9.80665**3}  # 8 mg at 20 g
    blind, _ = answered(tmp_path, more, doubted=False)
    assert {term.name for term in blind if term.verdict == "needed"} - TRUTH.keys()
    terms, ready = answered(tmp_path, more, doubted=True)
    assert ready.absorbed is not None
    assert "f_i in run centrifuge" in ready.absorbed.text
    assert not {term.name for term in terms if term.verdict == "needed"} - TRUTH.keys()
    sure = [term for term in terms if term.verdict in ("needed", "not needed")]
    pulls = [(term.full_mean - TRUTH.get(term.name, 0.0)) / term.full_sd for term in sure]
    assert "c_ij" in {term.name for term in sure}
    assert np.max(np.abs(pulls)) < 4.0


def test_noise_that_was_assumed_white_and_is_not_is_told_by_the_dwells(tmp_path):
    truth = {**TRUTH, "b0": 0.0}
    spec, runs = measured(tmp_path, truth, Noise(N=3e-4, B=0.0, K=5e-5))
    white = replace(spec, runs=tuple(replace(run, noise=NoiseRule("white")) for run in spec.runs))

    def worst(terms):
        return max(abs(term.full_mean - truth.get(term.name, 0.0)) / term.full_sd for term in terms)

    blind, _ = decided_terms(problem_of(white, runs), doubted=False)
    assert worst(blind) > 10.0
    assert {term.name for term in blind if term.verdict == "needed"} - TRUTH.keys()
    terms, ready = decided_terms(problem_of(white, runs), doubted=True)
    assert {run.found.origin for run in ready.summary.runs} == {"REML"}
    assert worst(terms) < 4.0
    assert {term.name for term in terms if term.verdict == "needed"} == TRUTH.keys() - {"b0"}


def test_what_is_missing_where_the_own_input_rests_casts_no_doubt_on_its_terms(tmp_path):
    truth = {"b0": 1e-4, "b1": 4e-4, "b0*T2": 1e-7}
    problem = problem_of(*measured(tmp_path, truth, study=HEATED))
    terms, ready = decided_terms(problem, doubted=True)
    assert ready.absorbed is not None
    assert {found.where for found in ready.absorbed.found} == {"b0*T2 over all runs", "T in run chamber"}
    beside = {extra.kind for extra in ready.summary.extras if extra.kind.startswith("lack")}
    assert "lack.T^2" in beside
    assert not any("w_i" in kind for kind in beside)
    (scale,) = (term for term in terms if term.name == "b1")
    assert scale.verdict == "needed"
    assert abs(scale.full_mean - truth["b1"]) < 4.0 * scale.full_sd < truth["b1"]


WHOLE = """
[study]
title = "a gyroscope's g-sensitivity is missing"
seed = 3
method = "plug-in"
[decision]
compare = false
[[sensor]]
id = "imu"
kind = "imu"
class = "mems_tactical"
library = { accelerometer = { powers = 1, asymmetry = -1 }, gyroscope = { powers = 1, asymmetry = -1 } }
truth = { ax.b1 = "400 ppm", gx = { b1 = "300 ppm", g_j = "8 (deg/h)/g" }, gy.m_j = "0.2 mrad" }
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 12, planes = 3, dwell = "10 s", rate = "2 Hz" }
[[sensor.run]]
name = "table"
procedure = "rate-table"
simulate = { rates = ["-200 deg/s", "-50 deg/s", "100 deg/s"], mounts = 9, dwell = "10 s", rate = "2 Hz" }
"""


def test_what_a_component_of_an_imu_lacks_stands_beside_its_terms_and_no_other_ones(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(WHOLE)
    components = {one.id.removeprefix("imu."): one for one in method.run(path).sensors}
    wanting = components.pop("gx")
    assert wanting.absorbed is not None
    assert "g_j over all runs (p below 1e-12" in wanting.absorbed.text
    assert "rad/s" in wanting.absorbed.text
    assert {spread.kind for spread in wanting.spreads if spread.names} >= {"lack.f_j"}
    assert not wanting.conditional
    assert all(
        one.absorbed is None and not one.spreads and not one.conditional for one in components.values()
    )
    truth = {("gx", "b1"): 300e-6, ("ax", "b1"): 400e-6, ("gy", "m_j"): 0.2e-3}
    for name, one in {**components, "gx": wanting}.items():
        for term in one.selection.terms:
            size = truth.get((name, term.name), 0.0)
            assert abs(term.full_mean - size) < 4.0 * term.full_sd
            assert term.verdict != "needed" or size


def test_a_misfit_that_nothing_could_be_put_beside_is_no_less_in_doubt(tmp_path, monkeypatch):
    def unsettled(*given, scattering=False, **more):
        if scattering:
            raise ConvergenceError("it does not settle")
        return summarized(*given, **more)

    monkeypatch.setattr(prepared, "summarized", unsettled)
    _, ready = answered(tmp_path, {"b4": 5e-8 / 9.80665**3}, doubted=True)
    assert ready.absorbed is None
    assert ready.misfit is not None
    assert ready.misfit.found
    assert ready.doubtful


def test_where_nothing_is_missing_nothing_stands_beside_the_library_but_the_arm(tmp_path):
    _, ready = answered(tmp_path, {}, doubted=True)
    assert ready.absorbed is None
    assert not ready.doubtful
    assert [extra.kind for extra in ready.summary.extras] == ["radius"]
    assert len(ready.rows[0]) == ready.summary.runs[0].samples


@pytest.mark.parametrize("share", [1.0, 0.1])
def test_columns_of_a_function_have_the_covariance_of_its_kernel_over_the_levels(share):
    u = np.repeat([-1.0, -0.4, 0.1, 0.7, 1.0], 3)
    runs = [Run("a", "other", Inputs(np.arange(15.0), {"f_i": share * u}, 1.0), u)]
    runs += [Run("b", "other", Inputs(np.arange(15.0), {"f_i": u}, 1.0), u)]
    lib = library("accelerometer", powers=3, asymmetry=3)
    made = functions_of(runs, [("a", "f_i"), ("b", "f_i")], lib, "m/s^2", 2.0)
    kinds = [extra.kind for extra in made.extras]
    own = [k for k, extra in enumerate(made.extras) if extra.name.endswith("a.f_i")]
    at = {run.name: made.columns[run.name](run.inputs) for run in runs}
    Z = at["a"][:, own]
    expected = share**2 * np.exp(-0.5 * (u[:, None] - u[None, :]) ** 2)
    np.testing.assert_allclose(Z @ Z.T, expected, atol=1e-6 * share**2)
    assert {extra.sd for extra in made.extras} == {2.0}
    assert sorted(set(kinds)) == ["lack.f_i", "lack.f_i^4", "lack.f_i^4p", "lack.f_i^5", "lack.f_i^5p"]
    fourth = at["b"][:, kinds.index("lack.f_i^4")]
    np.testing.assert_allclose(fourth, u**4)
    np.testing.assert_allclose(at["a"][:, kinds.index("lack.f_i^4")], (share * u) ** 4)


@pytest.mark.parametrize("lowest", [-1.0, 0.0])
def test_an_input_of_one_sign_has_no_asymmetry_that_could_be_missing(lowest):
    # its sign would be a bias there, and its size a scale error
    u = np.repeat([lowest, 0.1, 0.4, 0.7, 1.0], 3)
    run = Run("a", "other", Inputs(np.arange(15.0), {"f_i": u}, 1.0), u)
    lib = library("accelerometer", powers=1, asymmetry=-1)
    made = functions_of([run], [("a", "f_i")], lib, "m/s^2", 2.0)
    powers = {extra.kind.rpartition("^")[2] for extra in made.extras if "^" in extra.kind}
    assert powers == {"2", "3"} | ({"0p", "1p", "2p", "3p"} if lowest else set())


NOISE = Noise(6e-4, 4e-4, 3e-6)
CUBIC = library("accelerometer", powers=3, asymmetry=-1)


def swung(folder, fourth, rows=20_000):
    """A run without dwells, in memory and a part at a time: inputs that swing, one of them in four levels."""
    t = 0.1 * np.arange(rows)
    f_i, f_j = 50.0 * np.sin(2.0 * np.pi * t / 97.0), 9.8 * np.cos(2.0 * np.pi * t / 151.0)
    f_k = np.round(1.5 * np.sin(2.0 * np.pi * t / 400.0))
    output = f_i + 0.015 + 3e-4 * f_i + 3.5e-4 * f_j + fourth * f_i**4
    output += synthesise(NOISE, t, 0.1, np.random.default_rng(3))
    forces = {"f_i [m/s^2]": f_i, "f_j [m/s^2]": f_j, "f_k [m/s^2]": f_k}
    run = made.written({"t [s]": t, **forces, "output [m/s^2]": output}, folder)
    return replace(run, noise=NoiseRule("fixed", NOISE)), made.both_ways(run, 4096)


def test_columns_beside_a_run_that_is_read_in_parts_are_those_beside_its_rows_in_memory(tmp_path):
    of, factors = [("r", "f_i"), ("r", "f_j"), ("r", "f_k"), ("r", "w_i")], []
    for run in swung(tmp_path, 0.0)[1]:
        beside = functions_of([run], of, CUBIC, "m/s^2", 1.0)
        rows = beside.added(run, linear_of(run, CUBIC))
        factors.append((whitened_factor(rows, NOISE), reach_of(rows)))
    (whole, largest), (part, reach) = factors
    assert part.names == whole.names
    beyond = {"b0p", "b1p", "b2p", "b3p", "b4", "b4p", "b5", "b5p"}
    functions = {name.rpartition(".")[2] for name in whole.names[len(CUBIC.names) :]}
    assert functions == {"f_i", "f_j", "f_k", *beyond}
    np.testing.assert_allclose(reach, largest, rtol=1e-12)
    norms = np.linalg.norm(whole.R, axis=0)
    there = np.outer(norms, norms) > 0.0
    off = np.abs(whole.R.T @ whole.R - part.R.T @ part.R)[there] / np.outer(norms, norms)[there]
    assert off.max() < 1e-10


@pytest.mark.parametrize("fourth", [0.0, 3e-9])
def test_a_run_without_dwells_that_is_read_in_parts_is_searched_as_its_rows_in_memory(tmp_path, fourth):
    spec, runs = swung(tmp_path, fourth)
    entry = sensor("mems_tactical", kind="accelerometer")
    spec = SensorSpec("A-1", "accelerometer", entry, CUBIC, (spec,), {})
    (terms, held), (again, streamed) = (decided_terms(problem_of(spec, [run]), doubted=True) for run in runs)
    assert len(streamed.runs[0].inputs) < streamed.runs[0].samples == 20_000
    assert [extra.name for extra in streamed.summary.extras] == [extra.name for extra in held.summary.extras]
    assert (streamed.absorbed is not None) is (fourth > 0.0)
    if streamed.absorbed and held.absorbed:
        assert [one.where for one in streamed.absorbed.found] == ["b4 over all runs", "f_i in run r"]
        assert {term.name for term in again if term.verdict == "needed"} <= {"b0", "b1", "m_j"}
    for one, other in zip(terms, again, strict=True):
        # how far dwells of blocks scatter, by which functions are sized, is not quite as of rows
        assert abs(one.full_mean - other.full_mean) < 0.2 * one.full_sd
        assert other.full_sd == pytest.approx(one.full_sd, rel=0.2)


def test_mounts_that_a_turning_case_was_put_in_unseen_are_found_in_parts_as_in_memory(tmp_path):
    rng, noise, n = np.random.default_rng(3), Noise(2e-5, 4e-6, 3e-9), 12_000
    t, mount = 0.1 * np.arange(n), np.arange(n) * 8 // n
    angle = 2.0 * np.pi * t / 20.0
    across, odd = 9.80665 * np.sin(angle), mount % 2 == 1
    said = np.array([9.80665 * np.cos(angle), np.where(odd, 0.0, across), np.where(odd, across, 0.0)]).T
    f = said + np.cross(2e-4 * rng.normal(size=(8, 3))[mount], said)
    output = 1.0003 * f[:, 0] + 3.5e-4 * f[:, 1] + 0.015 + synthesise(noise, t, 0.1, rng)
    forces = {f"f_{axis} [m/s^2]": values for axis, values in zip("ijk", said.T, strict=True)}
    run = made.written({"t [s]": t, **forces, "mount": mount, "output [m/s^2]": output}, tmp_path, "tumble")
    run = replace(run, noise=NoiseRule("fixed", noise))
    entry, lib = (
        sensor("mems_tactical", kind="accelerometer"),
        library("accelerometer", powers=2, asymmetry=-1),
    )
    spec = SensorSpec("A-1", "accelerometer", entry, lib, (run,), {})
    (terms, held), (again, streamed) = (
        decided_terms(problem_of(spec, [one]), doubted=True) for one in made.both_ways(run, 2048)
    )
    (found,), (other,) = held.spreads, streamed.spreads
    assert (found.kind, other.kind) == ("fixture", "fixture")
    assert abs(found.mean - 2e-4) < 3.0 * found.sd
    # both settle to a thousandth of a posterior sd
    assert other.mean == pytest.approx(found.mean, rel=1e-3)
    assert all(abs(a.full_mean - b.full_mean) < 1e-3 * a.full_sd for a, b in zip(terms, again, strict=True))
