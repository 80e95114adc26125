"""What the library lacks, beside it: a fourth power that is missing no longer passes for a second one."""

import numpy as np
import pytest
from benches import decided_terms

from imubayes.inference.free_functions import functions_of
from imubayes.ladder.problem import problem_of
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.simulate import plan_run, simulate
from imubayes.sensors.terms import library
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


def answered(folder, more, *, doubted):
    path = folder / "study.toml"
    path.write_text(STUDY)
    (spec,) = read_study(path).sensors
    assert spec.sensor_class is not None
    runs = simulate(spec.sensor_class, [plan_run(run) for run in spec.runs], seed=2, truth={**TRUTH, **more})
    return decided_terms(problem_of(spec, runs), doubted=doubted)


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


def test_where_nothing_is_missing_nothing_stands_beside_the_library_but_the_arm(tmp_path):
    _, ready = answered(tmp_path, {}, doubted=True)
    assert ready.absorbed is None
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
    Z = made.columns["a"][:, own]
    expected = share**2 * np.exp(-0.5 * (u[:, None] - u[None, :]) ** 2)
    np.testing.assert_allclose(Z @ Z.T, expected, atol=1e-6 * share**2)
    assert {extra.sd for extra in made.extras} == {2.0}
    assert sorted(set(kinds)) == ["lack.f_i", "lack.f_i^4", "lack.f_i^4p", "lack.f_i^5", "lack.f_i^5p"]
    fourth = made.columns["b"][:, kinds.index("lack.f_i^4")]
    np.testing.assert_allclose(fourth, u**4)
    np.testing.assert_allclose(made.columns["a"][:, kinds.index("lack.f_i^4")], (share * u) ** 4)
