"""Exports of noise and filters against the definitions of N, B and K; every format of committed IMUs."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from exported_results import edited, no_noise, write_imu
from scipy.integrate import quad

from imubayes.reporting.export import FORMATS, PEAK, PEAK_AT, exported, filter_files, floor_process
from imubayes.reporting.export.characterized import characterized
from imubayes.sensors.catalogue import sensor, typical_noise
from imubayes.sensors.imu import COMPONENTS, forward, imu_of, signals
from imubayes.sensors.noise import Noise, allan_variance

REPORTS = Path(__file__).parents[3] / "reports"
STUDIES = ("imu_tk_xsens", "imucal_ferraris", "imu_tactical")

ACC = typical_noise(sensor("mems_tactical", kind="accelerometer"))
GYRO = typical_noise(sensor("mems_tactical", kind="gyroscope"))


def gauss_markov_deviation(tau: float, constant: float) -> float:
    """Allan deviation of a Gauss-Markov process of sd 1 (IEEE 952 annex C)."""
    x = tau / constant
    return math.sqrt(2.0 / x * (1.0 - (3.0 - 4.0 * math.exp(-x) + math.exp(-2.0 * x)) / (2.0 * x)))


def test_the_gauss_markov_process_has_the_floor_of_the_bias_instability_where_it_lies():
    sd, constant = floor_process(ACC)
    tau = np.geomspace(0.01, 100.0, 4001) * constant
    deviation = sd * np.array([gauss_markov_deviation(t, constant) for t in tau])
    peak = int(np.argmax(deviation))
    assert deviation[peak] == pytest.approx(math.sqrt(2.0 * math.log(2.0) / math.pi) * ACC.B, rel=2e-4)
    lowest = tau[np.argmin(allan_variance({"N": ACC.N, "K": ACC.K}, tau))]
    assert tau[peak] == pytest.approx(lowest, rel=5e-3)
    assert deviation[peak] / sd == pytest.approx(PEAK, rel=2e-4) and tau[peak] / constant == pytest.approx(
        PEAK_AT, rel=5e-3
    )


def test_kalibr_gets_continuous_densities_and_the_walk_of_the_bias(tmp_path):
    (text,) = exported(write_imu(tmp_path), "kalibr").values()
    found = {key: float(value) for key, value in re.findall(r"^(\w+): ([-+.e\d]+)", text, re.MULTILINE)}
    assert found["accelerometer_noise_density"] == pytest.approx(ACC.N, rel=1e-9)
    assert found["accelerometer_random_walk"] == pytest.approx(ACC.K, rel=1e-9)
    assert found["gyroscope_noise_density"] == pytest.approx(GYRO.N, rel=1e-9)
    assert found["gyroscope_random_walk"] == pytest.approx(GYRO.K, rel=1e-9)
    assert found["update_rate"] == pytest.approx(100.0)


GNSS_INS_SIM = {
    f"{stem}_{key}"
    for stem, walk in (("gyro", "arw"), ("accel", "vrw"))
    for key in ("b", walk, "b_stability", "b_corr")
}
"""Keys of a custom IMU in gnss_ins_sim/sim/imu_model.py; all but b_corr are required there."""


@pytest.fixture
def simulator(tmp_path) -> dict[str, np.ndarray]:
    """What gnss-ins-sim reads."""
    names: dict = {}
    exec(exported(write_imu(tmp_path), "json")["u_1_gnss_ins_sim.py"], names)
    return names["imu_err"]


def test_gnss_ins_sim_gets_every_key_that_it_asks_for_in_its_own_units(simulator, tmp_path):
    assert set(simulator) == GNSS_INS_SIM
    assert all(np.shape(values) == (3,) for values in simulator.values())
    # deg/sqrt(h): the angle's sd after an hour of white rate noise, N sqrt(3600 s)
    assert simulator["gyro_arw"] == pytest.approx([math.degrees(GYRO.N * math.sqrt(3600.0))] * 3)
    assert simulator["accel_vrw"] == pytest.approx([ACC.N * math.sqrt(3600.0)] * 3)
    assert simulator["gyro_b_stability"] == pytest.approx([math.degrees(floor_process(GYRO)[0]) * 3600.0] * 3)
    model = json.loads(exported(tmp_path, "json")["u_1_model.json"])
    terms = {t["name"]: t for t in model["components"]["gy"]["terms"]}
    assert all(one["symbol"] == f"<{name}>" for name, one in terms.items())  # those of the result
    assert simulator["gyro_b"][1] == pytest.approx(math.degrees(terms["b0"]["value"]) * 3600.0)


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_the_drift_that_gnss_ins_sim_makes_of_b_stability_has_the_floor_of_b(simulator, rate):
    """Its recursion (pathgen.bias_drift): ``x' = (1 - 1/(fs tau)) x + s sqrt(1 - exp(-2/(fs tau))) n``."""
    s, tau = math.radians(simulator["gyro_b_stability"][0]) / 3600.0, simulator["gyro_b_corr"][0]
    keeps, adds = 1.0 - 1.0 / (rate * tau), s * math.sqrt(1.0 - math.exp(-2.0 / (rate * tau)))
    stationary = math.sqrt(adds**2 / (1.0 - keeps**2))
    peak = stationary * gauss_markov_deviation(PEAK_AT, 1.0)
    # the recursion is right to first order in the step
    assert peak == pytest.approx(
        math.sqrt(2.0 * math.log(2.0) / math.pi) * GYRO.B, rel=2.0 / (rate * tau) + 1e-3
    )


def test_kalibr_gets_a_random_walk_where_none_was_found(tmp_path):
    """Kalibr's reader refuses zero: the walk is that of the Gauss-Markov process below its time constant."""
    (text,) = exported(edited(write_imu(tmp_path), no_noise("K")), "kalibr").values()
    walk = float(re.search(r"gyroscope_random_walk: (\S+) # no K was found", text).group(1))
    sd, tau = floor_process(Noise(GYRO.N, GYRO.B, 0.0))
    short = 1e-3 * tau
    # the Allan variance of a walk, K^2 t / 3, against that of the process
    process = sd * gauss_markov_deviation(short, tau)
    assert walk * math.sqrt(short / 3.0) == pytest.approx(process, rel=2e-3)


def test_process_noise_makes_the_variances_that_the_processes_have(tmp_path):
    (text,) = filter_files(characterized(write_imu(tmp_path))).values()
    record = json.loads(text)
    states = {state["name"]: (k, state) for k, state in enumerate(record["states"])}
    _, walk = states["gx.b0"]
    assert walk["q"] * 100.0 == pytest.approx(GYRO.K**2 * 100.0)  # the variance after 100 s of b0's walk
    k, floor = states["gx.B"]
    stationary, _ = quad(
        lambda s: floor["q"] * math.exp(2.0 * floor["decay"] * s), 0.0, 50.0 / -floor["decay"]
    )
    assert stationary == pytest.approx(floor["sd"] ** 2, rel=1e-6)
    assert record["P0"][k][k] == pytest.approx(stationary, rel=1e-6)


def test_the_initial_covariance_is_the_posterior_in_the_order_of_the_states(tmp_path):
    found = characterized(write_imu(tmp_path))
    record = json.loads(*filter_files(found).values())
    P0 = np.array(record["P0"])
    assert P0.shape == (len(record["states"]),) * 2
    for k, state in enumerate(record["states"]):
        place, term = state["name"].split(".")
        if term != "B":
            part = found.parts[place]
            j = part.component.library.names.index(term)
            assert P0[k, k] == part.covariance[j, j]


def test_px4_corrects_what_an_imu_with_bias_and_scale_puts_out():
    """Its formula, of ``sensor_calibration``, on the outputs of the model; other terms are named."""
    path = REPORTS / "imucal_ferraris"
    (text,) = exported(path, "px4", model="basic", accept_misfit=True).values()
    rows = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    assert {(row[0], row[1], row[4]) for row in rows} == {("1", "1", "9")}
    value = {row[2]: float(row[3]) for row in rows}
    parts = characterized(path, model="basic", accept_misfit=True).parts
    for k, axis in enumerate("xyz"):
        case = np.zeros((1, 3))
        case[0, k] = -7.0  # along the axis alone a misalignment adds nothing
        outputs = forward(imu_of({name: part.component for name, part in parts.items()}), signals(case, case))
        force = (outputs.f[0, k] - value[f"CAL_ACC0_{axis.upper()}OFF"]) * value[
            f"CAL_ACC0_{axis.upper()}SCALE"
        ]
        rate = outputs.w[0, k] - value[f"CAL_GYRO0_{axis.upper()}OFF"]
        gain = parts[f"g{axis}"].component
        assert force == pytest.approx(-7.0, rel=1e-7)
        assert rate == pytest.approx(-7.0 * (1.0 + gain.theta[gain.library.names.index("b1")]), rel=1e-7)
    assert "ax.m_j" in text.splitlines()[-1] and "gx.b1" in text.splitlines()[-1]


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("to", FORMATS)
def test_a_whole_imu_is_exported_in_every_format(study, to):
    digest = characterized(REPORTS / study, accept_misfit=True).source.sha256
    texts = exported(REPORTS / study, to, accept_misfit=True, model="basic" if to == "px4" else "best")
    assert texts and all(digest in text for text in texts.values())


@pytest.mark.parametrize("study", STUDIES)
def test_simulators_and_filters_get_the_biases_of_the_model_that_predicts_best(study):
    raw = json.loads((REPORTS / study / "result.json").read_text())["sensors"]
    best = {one["id"][-2:]: one["compensations"][0] for one in raw}
    place = {name: one["terms"].index("b0") for name, one in best.items()}
    bias = {name: one["mean"][place[name]] for name, one in best.items()}
    names: dict = {}
    texts = exported(REPORTS / study, "json", accept_misfit=True)
    exec(next(text for name, text in texts.items() if name.endswith("gnss_ins_sim.py")), names)
    error, record = (
        names["imu_err"],
        json.loads(next(iter(exported(REPORTS / study, "filter", accept_misfit=True).values()))),
    )
    np.testing.assert_allclose(error["accel_b"], [bias[c] for c in COMPONENTS[:3]], rtol=1e-8)
    kept = {state["name"]: k for k, state in enumerate(record["states"])}
    for c in COMPONENTS:
        sd = math.sqrt(best[c]["covariance"][place[c]][place[c]])
        P = record["P0"][kept[f"{c}.b0"]][kept[f"{c}.b0"]]
        assert math.sqrt(P) == pytest.approx(sd, rel=1e-9)
