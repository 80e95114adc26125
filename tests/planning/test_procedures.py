"""What each procedure sees, as its docstring says: simulated, fitted with the full library, and observed."""

from collections import namedtuple

import numpy as np
import pytest

import imubayes as ib
from imubayes.algebra.factor import posterior
from imubayes.inference.observability import observe
from imubayes.inference.prior import class_sd
from imubayes.sensors.catalogue import typical_noise

WIDE = 1000.0
"""Units so much worse than their class: what a test sees at all is then seen well, whatever the class."""

ROUGH = {"dwell": 30.0, "rate": 1.0}


Case = namedtuple("Case", "name kind plan sees partners library")
"""A procedure, what it sees by itself, and what some terms are confounded with."""


POWERS = {"asymmetry": -1}
LINEAR = {"powers": 1, "asymmetry": -1, "set": "extended"}
EXTENDED = {"set": "extended"}
ALL_F = "b0 b1 b2 b3 b0p b1p b2p m_j m_k c_ij c_ik c_jj c_jk c_kk"
SQUARES = {"b0": "b2 c_jj c_kk"}
DIAGONAL = "S_ii S_jj S_kk"
TRACE = {"b0": DIAGONAL}
LIKE_B1 = {"b1": "b3"}
EARTH = {"dwell": 600.0, "rate": 0.1, "latitude": 0.6}
RATES = [-5.0, -3.5, -2.0, -0.5, 0.5, 2.0, 3.5, 5.0]

CASES = (
    Case("4 positions", "accelerometer", ib.positions(4, **ROUGH), "m_j", {"b0": "b2 c_jj"} | LIKE_B1,
         POWERS),
    Case("6 positions", "accelerometer", ib.positions(6, **ROUGH), "m_j m_k", SQUARES | LIKE_B1, POWERS),
    Case("12 positions", "accelerometer", ib.positions(12, **ROUGH), "b1 b3 m_j c_ij", {"b0": "b2 c_jj"},
         POWERS),
    Case("24 positions", "accelerometer", ib.positions(24, **ROUGH), "m_j m_k", SQUARES | LIKE_B1, POWERS),
    Case("26 positions", "accelerometer", ib.positions(26, **ROUGH), "b1 b3 m_j m_k c_ij c_ik c_jk", SQUARES,
         POWERS),
    Case("26 positions, asymmetries", "accelerometer", ib.positions(26, **ROUGH), "m_j m_k c_ij c_ik c_jk",
         SQUARES | {"b1": "b3 b0p b2p"}, {}),
    Case("tumble", "accelerometer", ib.tumble(**ROUGH), "b1 b3 b0p b1p b2p m_j m_k c_ij c_ik c_jk", SQUARES,
         {}),
    Case("centrifuge", "accelerometer", ib.centrifuge([1, 5, 20], **ROUGH), f"{ALL_F} S_ij S_ik S_jk", {},
         {}),
    Case("centrifuge with ramps", "accelerometer", ib.centrifuge([1, 5, 20], ramp=True, **ROUGH),
         f"{ALL_F} S_ij S_ik S_jk {DIAGONAL} s_i s_j s_k", {}, EXTENDED),
    Case("centrifuge along the arm", "accelerometer", ib.centrifuge([1, 5, 20, 40], mounts=4, **ROUGH),
         "b2 b3 b0p b2p", {"b0": "m_j m_k c_jj c_kk", "b1": "c_ij c_ik", "b1p": "S_jj S_kk"}, EXTENDED),
    Case("oscillation", "accelerometer", ib.oscillation([1.0, 5.0, 10.0], dwell=4.0),
         f"m_j m_k S_ij S_ik S_jk {DIAGONAL} s_i s_j s_k", SQUARES | {"b1": "b3 c_ij c_ik"},
         EXTENDED | POWERS),
    Case("vibration", "accelerometer", ib.vibration([0.0, 2.0, 5.0], dwell=2.0), ALL_F, {}, {}),
    Case("log", "gyroscope", ib.static(3600.0, 0.1, latitude=0.6), "", {"b0": "b1 m_j c_ij c_jj g_i S_ii"},
         LINEAR),
    Case("24 positions", "gyroscope", ib.positions(24, **EARTH), "b1 m_j m_k g_i g_j g_k", TRACE, LINEAR),
    Case("26 positions", "gyroscope", ib.positions(26, **EARTH), "b1 m_j m_k g_i g_j g_k", TRACE, LINEAR),
    Case("rate steps, input axis up", "gyroscope", ib.rate_table(RATES, mounts=1, **ROUGH),
         "b1 b2 b3 b0p b1p b2p", {"b0": "g_i S_ii"}, EXTENDED),
    Case("rate steps", "gyroscope", ib.rate_table(RATES, **ROUGH),
         f"{ALL_F.removeprefix('b0 ')} g_i g_j g_k S_ij S_ik S_jk", TRACE, EXTENDED),
    Case("oscillation", "gyroscope", ib.oscillation([1.0, 5.0, 10.0], dwell=4.0),
         "b1 m_j m_k g_i g_j g_k s_i s_j s_k", TRACE, EXTENDED),
    Case("centrifuge", "gyroscope", ib.centrifuge([1, 5, 20], **ROUGH),
         f"g_i g_j g_k S_ij S_ik S_jk {DIAGONAL}", {}, LINEAR),
    Case("vibration", "gyroscope", ib.vibration([0.0, 2.0, 5.0], dwell=2.0),
         f"b0 g_i g_j g_k S_ij S_ik S_jk {DIAGONAL}", {}, EXTENDED),
)  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.kind[:4]} {case.name}")
def test_full_library_recovers_the_truth_and_what_is_seen_is_resolved_and_apart_from_its_partners(case):
    lib = ib.library(case.kind, **case.library)
    entry = ib.sensor("mems_tactical", kind=case.kind)
    noise, wide = typical_noise(entry), WIDE * class_sd(entry, lib)
    rng = np.random.default_rng(5)
    truth = dict(zip(lib.names, rng.normal(0.0, wide), strict=True))
    runs = ib.simulate(entry, [case.plan], seed=rng, truth=truth, noise=noise)
    known = {run.name: ib.NoiseRule("fixed", noise) for run in runs}
    summary = ib.summarize(runs, lib, sensor=entry, rules=known)
    mean, sd = posterior(summary.factor, wide)
    assert np.abs((mean - np.array([truth[name] for name in lib.names])) / sd).max() < 4.0
    seen = observe(summary.factor, wide, summary.facts, reach=summary.reach)
    ratio = dict(zip(lib.names, seen.ratio.tolist(), strict=True))
    assert {name: ratio[name] for name in case.sees.split() if not ratio[name] < 0.5} == {}
    hidden = {name for group in seen.groups for name in group.terms}
    assert not hidden & set(case.sees.split())
    assert {name: set(seen.partners(name)) for name in case.partners} == {
        name: set(others.split()) for name, others in case.partners.items()
    }
