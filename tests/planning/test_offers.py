"""Plans for several components in one case: what the hand or the bench will tell, against what it told."""

from dataclasses import replace

import numpy as np
import pytest
from plan_studies import plan_of

from imubayes.algebra.factor import posterior_root
from imubayes.campaign.preparation import prepare_case, runs_of
from imubayes.planning import PlanProblem, Step, root, worth
from imubayes.planning.exchange import _promised, _promised_additions, with_step
from imubayes.planning.offers import bench_columns
from imubayes.planning.proposal import propose
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import NoiseRule
from imubayes.study.schema import read_study, write_planned

HAND = """
[study]
seed = 3
[[sensor]]
id = "A"
kind = "imu"
class = "mems_consumer"
[plan]
time = "1 min"
units = 2
[[plan.run]]
name = "hand"
procedure = "free-tumble"
candidates = { attitudes = 18 }
dwell = ["3 s"]
rate = "100 Hz"
settle = "2 s"
"""
TRIAD = HAND.replace('"imu"', '"accelerometer"')
BENCH = """
[study]
seed = 3
[[sensor]]
id = "A"
kind = "imu"
class = "mems_tactical"
[sensor.library]
accelerometer = { powers = 1, asymmetry = -1 }
gyroscope = { powers = 1, asymmetry = -1 }
[sensor.reference]
gravity = true
fixture = "20 arcsec"
[plan]
time = "15 min"
units = 2
[[plan.run]]
name = "tumble"
procedure = "tumble"
candidates = { angles = 4, planes = 3 }
dwell = ["30 s"]
rate = "1 Hz"
[[plan.run]]
name = "rates"
procedure = "rate-table"
candidates = { rates = ["-50 deg/s", "50 deg/s"], mounts = 3 }
dwell = ["20 s"]
rate = "1 Hz"
"""


def _problem(study, kind="worst"):
    bench = bench_columns(study)
    return bench, PlanProblem(bench.menus, bench.start, kind, np.eye(len(bench.sd)), study.time)


def _known_noise(spec):
    """The sensor with the typical noise of its class as known, so that no estimate of it counts."""
    rule = NoiseRule("fixed", typical_noise(spec.sensor_class))
    beside = _known_noise(spec.gyroscope) if spec.gyroscope else None
    return replace(spec, runs=tuple(replace(run, noise=rule) for run in spec.runs), gyroscope=beside)


@pytest.mark.parametrize("text", [HAND, BENCH], ids=["hand", "bench"])
def test_sds_of_a_plan_are_those_of_the_analysis_of_its_simulated_data(tmp_path, text):
    # a plan makes its rows from attitudes; the analysis finds stills in samples, and integrates the turns
    found = propose(plan_of(tmp_path, text))
    (spec,) = read_study(write_planned(found, tmp_path)).sensors
    spec = _known_noise(spec)
    _, ready = prepare_case(spec, runs_of(spec, 3, 0), np.random.default_rng(1))
    _, S = posterior_root(ready.summary.factor, ready.prior.sd)
    told = dict(zip(ready.summary.names, np.linalg.norm(S, axis=1), strict=True))
    ratios = {
        name: told[name] / sd
        for name, sd, prior in zip(found.study.terms, found.best.sd, found.prior_sd, strict=True)
        if name in found.needed and sd < 0.9 * prior
    }
    assert len(ratios) >= 9
    assert 0.9 < min(ratios.values()) <= max(ratios.values()) < 1.1, ratios


def test_terms_that_a_hand_cannot_tell_leave_b0_as_sure_as_nine_parameters_do(tmp_path):
    run = """[[sensor.run]]
name = "hand"
procedure = "free-tumble"
simulate = { attitudes = 26, dwell = "4 s" }
"""

    def simulated(text):
        file = tmp_path / "study.toml"
        file.write_text(text.partition("[plan]")[0].replace("mems_consumer", "mems_industrial") + run)
        (spec,) = read_study(file).sensors
        return _known_noise(spec)

    def sds(spec):
        _, ready = prepare_case(spec, runs_of(spec, 1, 0))
        _, S = posterior_root(ready.summary.factor, ready.prior.sd)
        return dict(zip(ready.summary.names, np.linalg.norm(S, axis=1), strict=True))

    whole, triad = sds(simulated(HAND)), simulated(TRIAD)
    nine = tuple(term for term in triad.library.terms if term.name in ("b0", "b1", "m_j", "m_k"))
    alone = sds(replace(triad, library=replace(triad.library, terms=nine)))
    assert len(alone) == 9
    for axis in "xyz":
        assert whole[f"a{axis}.b0"] < 1.2 * alone[f"a{axis}.b0"]


@pytest.mark.parametrize("kind", ["D", "worst", "rms"])
@pytest.mark.parametrize("text", [HAND, BENCH], ids=["hand", "bench"])
def test_promise_for_all_signals_of_a_dwell_is_what_is_computed_afresh(tmp_path, text, kind):
    _, problem = _problem(plan_of(tmp_path, text), kind)
    steps = tuple(Step(0, k, 3.0) for k in (0, 5, 3, 8, 2))
    changes = [{2: 7}, {1: 8, 3: 5}, {1: 2, 4: 5}]  # of which the last swaps
    afresh = [
        worth(problem, tuple(one._replace(setting=c.get(k, one.setting)) for k, one in enumerate(steps)))
        for c in changes
    ]
    # of a hand the drift of three accelerometers weighs by attitude, which a promise leaves as it was
    exact = 1e-9 if text is BENCH else 1e-2
    np.testing.assert_allclose(_promised(problem, steps, 0, changes), afresh, rtol=exact)
    new = Step(0, 6, 3.0)
    (promised,) = _promised_additions(problem, steps, root(problem, steps), [new])
    assert promised == pytest.approx(worth(problem, with_step(problem, steps, new)), rel=0.02)


def test_an_attitude_that_is_not_known_tells_its_length_alone(tmp_path):
    # of three rows of a still, rotations of the case take two: what is left is their Schur complement
    bench, _ = _problem(plan_of(tmp_path, TRIAD))
    (norms,) = bench.menus[0].signals
    attitudes = np.transpose([bench.plans[0].inputs.channels[f"f_{axis}"] for axis in "ijk"]) / 9.80665
    rows = norms.wide(norms.X, len(bench.sd)) / bench.sd
    for up, row, axes in zip(attitudes, rows, norms.axes, strict=True):
        X = _rows_of_components(bench.names, up)
        turned = 9.80665 * np.cross(np.eye(3), up).T
        away = np.eye(3) - turned @ np.linalg.pinv(turned)
        np.testing.assert_allclose(np.outer(row, row), X.T @ away @ X, atol=1e-9)
        np.testing.assert_allclose(np.abs(axes), np.abs(up), atol=1e-12)


def _rows_of_components(names, up):
    """Rows (3, c) of ax, ay, az by the model equation: bias, scale, misalignments and products."""
    X = np.zeros((3, len(names)))
    for c, order in enumerate(((0, 1, 2), (1, 2, 0), (2, 0, 1))):
        i, j, k = (9.80665 * up)[list(order)]
        terms = {"b0": 1.0, "b1": i, "m_j": j, "m_k": k, "c_ij": i * j, "c_ik": i * k, "c_jk": j * k,
                 "c_jj": j * j, "c_kk": k * k}  # fmt: skip
        for term, value in terms.items():
            if (name := f"a{'xyz'[c]}.{term}") in names:
                X[c, names.index(name)] = value
    return X


def test_plan_in_the_hand_is_told_by_attitudes_and_needs_what_a_hand_can_tell(tmp_path):
    found = propose(plan_of(tmp_path, TRIAD))
    assert set(found.needed) == {f"a{x}.{term}" for x in "xyz" for term in ("b0", "b1", "m_j", "m_k")} - {
        "ay.m_k", "az.m_j", "az.m_k"}  # fmt: skip
    assert {"x up", "-y up", "x-z up"} <= {at for _, at in found.settings[0]}
    assert len(found.best.steps) * 5.0 <= 60.0
