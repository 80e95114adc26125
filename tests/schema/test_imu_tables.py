"""``kind = "imu"``: what is said of both kinds at once, and what is refused."""

import json

import numpy as np
import pytest
from run_files import csv_of
from small_studies import IMU, study_of, written

from imubayes.study.method import check, run
from imubayes.study.schema import read_runs, read_study, record_study

CHANNELS = "ax [m/s^2],ay [m/s^2],az [m/s^2]", "gx [deg/s],gy [deg/s],gz [deg/s]"

NOISE = 'noise = { accelerometer = "white", gyroscope = { N = "0.01 deg/s/sqrt(Hz)" } }'
HEAD, _, RUN = IMU.replace('kind = "imu"', f'kind = "imu"\n{NOISE}').partition("[[sensor.run]]")
RUN = f"[[sensor.run]]{RUN}"
FERRARIS = RUN.replace("free-tumble", "ferraris")
NO_SENSOR = HEAD.replace('kind = "imu"', 'kind = "imu"\naccept_prior_conflict = true')
"""Of records that are only numbers."""


def record(path, channels, *, start=0.0, rows=40):
    t = start + 0.01 * np.arange(rows)
    values = np.random.default_rng(1).normal(size=(rows, 3 * len(channels)))
    csv_of(path.parent, ",".join(("t [s]", *channels)), np.column_stack((t, values)), path.name)


def test_each_kind_has_its_own_class_library_prior_and_noise(tmp_path):
    (spec,) = study_of(tmp_path, HEAD + RUN).sensors
    assert spec.gyroscope is not None
    assert (spec.kind, spec.gyroscope.kind) == ("accelerometer", "gyroscope")
    assert [one.sensor_class.id for one in (spec, spec.gyroscope)] == ["mems_industrial", "mems_consumer"]
    assert "g_i" in spec.gyroscope.library.names
    # what 1 g and slow turns can tell, unless the study asks for more
    assert {"b2", "b0p"}.isdisjoint((*spec.library.names, *spec.gyroscope.library.names))
    assert spec.prior == {}
    assert spec.gyroscope.prior == pytest.approx({"g_i": np.deg2rad(300.0) / 3600.0 / 9.80665})
    assert spec.runs[0].noise.rule == "white"
    assert pytest.approx(np.deg2rad(0.01)) == spec.gyroscope.runs[0].noise.value.N


KNOWN = """
[[sensor.run]]
name = "turns"
procedure = "rate-table"
simulate = { rates = ["-100 deg/s", "50 deg/s"], dwell = "2 s", rate = "5 Hz" }
[[sensor.run]]
name = "faces"
procedure = "tumble"
simulate = { positions = 6, dwell = "10 s", rate = "2 Hz" }
"""
GRAVITY = 'bench = "drawn"\nreference = { gravity = "1 mg" }'
BENCH = """
bench = "drawn"
reference = { fixture_common = "1 mrad", turn_on = { accelerometer = "1 mg", gyroscope = "100 deg/h" } }
"""


def known(text="", runs=KNOWN):
    return HEAD.replace('kind = "imu"', f'kind = "imu"\n{text}') + runs


def test_a_simulated_imu_is_the_same_when_it_is_recorded(tmp_path):
    study = study_of(tmp_path, known(BENCH))
    (tmp_path / "out").mkdir()
    record_study(study, tmp_path / "out")
    for one, other in zip(read_runs(study.path), read_runs(tmp_path / "out" / "study.toml"), strict=True):
        np.testing.assert_array_equal(one.output, other.output)
        assert one.inputs.channels.keys() == other.inputs.channels.keys()
    truth = json.loads((tmp_path / "out" / "truth.json").read_text(encoding="utf-8"))["A"]
    assert {"ax.b0", "gz.g_i", "fixture_common_i", "turn_on.faces.gx"} <= truth.keys()


def test_offsets_since_turn_on_have_an_sd_for_each_kind(tmp_path):
    (spec,) = study_of(tmp_path, known(BENCH)).sensors
    assert spec.reference["turn_on"] == pytest.approx(9.80665e-3)
    assert spec.gyroscope is not None
    assert spec.gyroscope.reference["turn_on"] == pytest.approx(np.deg2rad(100.0) / 3600.0)
    assert spec.reference["fixture_common"] == spec.gyroscope.reference["fixture_common"] == 1e-3


@pytest.mark.parametrize(
    "truth",
    ['truth = { ax.b0 = "1 mg", gz.b1 = "30 ppm" }', 'truth = { "ax.b0" = "1 mg", "gz.b1" = "30 ppm" }'],
)
def test_truth_is_by_component_and_term(tmp_path, truth):
    (spec,) = study_of(tmp_path, known(truth)).sensors
    assert spec.gyroscope is not None
    assert spec.truth == pytest.approx({"ax.b0": 9.80665e-3})
    assert spec.gyroscope.truth == pytest.approx({"gz.b1": 3e-5})


def test_a_simulated_imu_is_characterized_to_its_end(tmp_path):
    text = f'[study]\nmethod = "exact"\n[decision]\ncompare = false\n{known(GRAVITY)}'
    lowest = "powers = 1\nasymmetry = -1"
    small = f"[sensor.library.accelerometer]\n{lowest}\n[sensor.library.gyroscope]\nasymmetry = -1"
    text = (
        text.replace("[sensor.library.gyroscope]", small)
        .replace('set = "extended"', "")
        .replace("g_i =", "S_ij =")
    )
    text = text.replace("deg/h/g", "deg/h/g^2")
    result = run(study_of(tmp_path, text))
    assert [one.id for one in result.sensors] == [
        f"A.{name}" for name in ("ax", "ay", "az", "gx", "gy", "gz")
    ]
    for one in result.sensors:
        assert one.pooled
        assert [part.name for part in one.runs] == [f"turns ({one.id[2:]})", f"faces ({one.id[2:]})"]
    (angle,) = [
        a
        for a in result.sensors[0].calibration["angles"]
        if a["name"] == "nonorthogonality_xy" and a["of"] == "gyroscope"
    ]
    assert 0.0 < angle["sd"] < 1e-3


def test_six_components_can_be_checked_before_the_test(tmp_path):
    record(tmp_path / "run.csv", CHANNELS, rows=90)
    ups = [*"xyz", "-x", "-y", "-z"]
    parts = [f'{{ rows = [{10 * k}, {10 * k + 10}], up = "{up}" }}' for k, up in enumerate(ups)]
    parts += [
        f'{{ rows = [{10 * k + 60}, {10 * k + 70}], up = "{up}", turn = "90 deg" }}'
        for k, up in enumerate("xyz")
    ]
    path = written(tmp_path, NO_SENSOR + FERRARIS + f"sections = [{', '.join(parts)}]\n")
    assert [one.id for one in check(read_study(path))] == ["A.ax", "A.ay", "A.az", "A.gx", "A.gy", "A.gz"]
