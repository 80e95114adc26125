"""A study file is one study, of one kind, and becomes the values that the method works on."""

import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from small_studies import RUN, study_of
from small_studies import SENSOR as HEAD

from imubayes.campaign import Sampling
from imubayes.cli import kinds
from imubayes.errors import StudyError
from imubayes.rig.bench import KINDS
from imubayes.rig.plans import normal_gravity
from imubayes.rig.simulate import plan_run
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library
from imubayes.study.schema import FORMS, OF_THE_TOOL, SENSORS, read, read_study
from imubayes.units import factor

G = 9.80665
UG = G * 1e-6
ULPS = 1e-14
"""A few multiplications of conversion factors."""


def _sensor(folder: Path, text: str):
    (sensor,) = study_of(folder, text).sensors
    return sensor


def test_smallest_study_has_the_defaults_of_the_design(tmp_path):
    study = study_of(tmp_path, HEAD.replace('class = "mems_tactical"\n', "") + RUN)
    (sensor,) = study.sensors
    (run,) = sensor.runs
    assert (study.title, study.seed) == ("study", 0)
    assert sensor.sensor_class is None
    assert replace(sensor.library, ties=()) == library("accelerometer", powers=3, asymmetry=2, set="slide")
    assert run.file == tmp_path / "run.csv"
    assert run.noise == NoiseRule()
    assert study.text == study.path.read_text()
    assert (study.sampling, study.appendices) == (Sampling(), ())
    asked = study_of(tmp_path, '[noise]\nidentify = "all"\ncandidates = ["B", "K"]\n' + HEAD + RUN).noise
    assert (study.noise.identify, asked.identify, asked.candidates) == ("static", "all", ("B", "K"))
    assert (sensor.reference, sensor.robust, sensor.unit, sensor.session) == ({}, False, "", "")


@pytest.mark.parametrize("name", KINDS)
def test_error_of_the_bench_is_taken_as_printed_and_by_default_where_there_is_one(name, tmp_path):
    def reference(value):
        return _sensor(tmp_path, HEAD + f"reference = {{ {name} = {value} }}\n" + RUN).reference

    kind = KINDS[name]
    printed = f'"1 {kind.printed}"'
    assert reference(printed) == pytest.approx({name: factor(kind.printed, kind.unit)}, rel=ULPS)
    assert reference("false") == {}
    if kind.default is None:
        with pytest.raises(StudyError, match=rf"reference.{name}: .* quantity such as {printed}"):
            reference("true")
    else:
        assert reference("true") == {name: kind.default}


def test_sessions_of_one_unit_are_told_apart(tmp_path):
    heads = [
        HEAD.replace('"A"', f'"{id}"') + f'unit = "{id[0]}"\nsession = "{id[1]}"\nrobust = true\n'
        for id in ("U1", "U2", "V1")
    ]
    sensors = study_of(tmp_path, "".join(head + RUN for head in heads)).sensors
    assert [(one.unit, one.session) for one in sensors] == [("U", "1"), ("U", "2"), ("V", "1")]
    assert all(one.robust for one in sensors)


@pytest.mark.parametrize(
    ("table", "wraps"),
    [
        ('unit = "count", scale = "15.625 ns/count", wraps = "4294967296 count"', 2.0**32),
        ('unit = "us", wraps = "4294967296 us"', 2.0**32),
        ('unit = "us", wraps = "4294.967296 s"', 2.0**32),
        ('unit = "ms", wraps = "1 min"', 60000.0),
        ('unit = "s", wraps = "67.108864 s"', 67.108864),
    ],
)
def test_wrap_of_a_clock_is_exact_in_the_unit_of_the_file(table, wraps, tmp_path):
    sensor = _sensor(tmp_path, HEAD + RUN + f'[sensor.run.columns]\nt = {{ column = "x", {table} }}\n')
    assert sensor.runs[0].columns["t"].wraps == wraps


def test_library_keys_are_the_arguments_of_library(tmp_path):
    options = 'powers = 4\nasymmetry = -1\nset = "extended"\ntemperature = 2\ntemperature_of = ["m_j"]\n'
    sensor = _sensor(tmp_path, HEAD + "[sensor.library]\n" + options + RUN)
    asked = {"powers": 4, "asymmetry": -1, "set": "extended", "temperature": 2, "temperature_of": ("m_j",)}
    made = library("accelerometer", **asked, technology=sensor.sensor_class.technology)
    assert replace(sensor.library, ties=()) == made


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        # SI = (x - offset) scale, whatever unit each of the three is written in
        ('unit = "count", scale = "2.4e-3 m/s^2/count", offset = "33124 count"', (2.4e-3, 33124.0)),
        ('unit = "count", scale = "2 mg", offset = "5"', (2e-3 * G, 5.0)),
        ('unit = "g", scale = "1.002", offset = "0.1 g"', (1.002 * G, 0.1)),
        ('unit = "mg", scale = "1000200 ppm", offset = "1 g"', (1.0002 * G * 1e-3, 1000.0)),
    ],
)
def test_scale_and_offset_are_read_in_their_units(table, expected, tmp_path):
    sensor = _sensor(tmp_path, HEAD + RUN + f'[sensor.run.columns]\noutput = {{ column = "adc", {table} }}\n')
    column = sensor.runs[0].columns["output"]
    assert column.column == "adc"
    assert (column.scale, column.offset) == pytest.approx(expected, rel=ULPS)


def test_column_can_be_given_by_name_number_or_unit_alone(tmp_path):
    text = '[sensor.run.columns]\noutput = "adc"\nf_i = 3\nmount = "plane"\nt = { unit = "ms" }\n'
    (run,) = _sensor(tmp_path, HEAD + RUN + 'ignore = ["f_q"]\n' + text).runs
    names = {channel: one.column for channel, one in run.columns.items()}
    assert names == {"output": "adc", "f_i": 3, "mount": "plane", "t": None}
    assert run.columns["t"].unit == "ms" and run.ignore == ("f_q",)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('"estimate"', NoiseRule()),
        ('"white"', NoiseRule("white")),
        ('{ run = "log" }', NoiseRule("fixed", like="log")),
        ('{ N = "60 ug/sqrt(Hz)" }', NoiseRule("fixed", Noise(60 * UG, 0.0, 0.0))),
        (
            '{ N = "0.036 m/s/sqrt(h)", B = "40 ug", K = "0.3 ug/sqrt(s)" }',
            NoiseRule("fixed", Noise(0.036 / 60.0, 40 * UG, 0.3 * UG)),
        ),
    ],
)
def test_noise_of_a_run_wins_over_that_of_its_sensor(text, rule, tmp_path):
    log = RUN.replace("tumble", "log").replace('procedure = "log"', 'procedure = "static"')
    sensor = _sensor(tmp_path, HEAD + 'noise = "white"\n' + RUN + f"noise = {text}\n" + log)
    noise, usual = sensor.runs[0].noise, sensor.runs[1].noise
    assert usual == NoiseRule("white")
    assert (noise.rule, noise.like, noise.value is None) == (rule.rule, rule.like, rule.value is None)
    if rule.value:
        assert asdict(noise.value) == pytest.approx(asdict(rule.value), rel=ULPS)


def test_gravity_by_place_is_normal_gravity(tmp_path):
    free = RUN.replace('procedure = "tumble"', 'procedure = "free-tumble"')
    place = _sensor(tmp_path, HEAD + free + 'gravity = { latitude = "45.4 deg", height = "12 m" }\n')
    value = _sensor(tmp_path, HEAD + free + 'gravity = "9.81744 m/s^2"\n')
    assert place.runs[0].gravity == pytest.approx(normal_gravity(math.radians(45.4), 12.0), rel=ULPS)
    assert value.runs[0].gravity == 9.81744


def test_simulated_profile_has_si_options(tmp_path):
    runs = """
[[sensor.run]]
name = "arm"
procedure = "centrifuge"
[sensor.run.simulate]
levels = ["1 g", "196.133 m/s^2"]
dwell = "1 min"
rate = "10 Hz"
arm = "100 cm"
ramp = true
[[sensor.run]]
name = "log"
procedure = "static"
simulate = { duration = "2 h", rate = "1 Hz", up = [0, 0, 1] }
"""
    arm, log = _sensor(tmp_path, HEAD + runs).runs
    assert arm.simulate == {
        "profile": "centrifuge", "levels": pytest.approx((1.0, 20.0), rel=ULPS), "dwell": 60.0, "rate": 10.0,
        "arm": pytest.approx(1.0, rel=ULPS), "ramp": True,
    }  # fmt: skip
    assert log.simulate == {"profile": "static", "duration": 7200.0, "rate": 1.0, "up": (0.0, 0.0, 1.0)}


def test_truth_is_read_in_the_unit_of_its_term_and_may_leave_the_library(tmp_path):
    text = HEAD + '[sensor.truth]\nb0 = "1.5 mg"\nb1 = "300 ppm"\nb2 = "30 ug/g^2"\nb4 = "1 ug/g^4"\n' + RUN
    sensor = _sensor(tmp_path, text.replace('file = "run.csv"', "simulate = {}"))
    assert sensor.truth == pytest.approx(
        {"b0": 1.5e-3 * G, "b1": 3e-4, "b2": 30e-6 / G, "b4": 1e-6 / G**3}, rel=ULPS
    )


@pytest.mark.parametrize(
    ("said", "tied"),
    [
        ("", True),
        ('[sensor.prior]\ns_j = "200 ug/(rad/s^2)"\n', True),
        ('[sensor.prior]\ns_j = "200 ug/(rad/s^2)"\nS_ik = "50 ug/(rad/s)^2"\n', False),
        ('[sensor.truth]\ns_j = "200 ug/(rad/s^2)"\nS_ik = "200 ug/(rad/s)^2"\n', True),
        ('[sensor.truth]\ns_j = "200 ug/(rad/s^2)"\n', False),
    ],
)
def test_what_a_lever_arm_ties_is_one_unless_the_study_says_that_it_is_two(tmp_path, said, tied):
    spec = _sensor(tmp_path, HEAD + said + RUN.replace('file = "run.csv"', "simulate = {}"))
    assert spec.library.tied == ((("s_j", "S_ik"),) if tied else ())
    if tied and spec.prior:  # a lever arm has one size, of whichever term it is stated
        assert spec.prior == pytest.approx(dict.fromkeys(("s_j", "S_ik"), 200e-6 * G), rel=ULPS)


def test_prior_sds_are_read_in_the_units_of_their_terms(tmp_path):
    sensor = _sensor(tmp_path, HEAD + '[sensor.prior]\nb0 = "2 mg"\nb2 = "50 ug/g^2"\n' + RUN)
    assert sensor.prior == pytest.approx({"b0": 2e-3 * G, "b2": 50e-6 / G}, rel=ULPS)


def test_data_folder_is_that_of_the_variable_or_beside_the_project(tmp_path, monkeypatch):
    folder = tmp_path / "project" / "studies"
    folder.mkdir(parents=True)
    text = HEAD + RUN.replace("run.csv", "$IMUBAYES_DATA/a/b.mat")
    monkeypatch.setenv("IMUBAYES_DATA", "/data")
    assert _sensor(folder, text).runs[0].file == Path("/data/a/b.mat")
    monkeypatch.delenv("IMUBAYES_DATA")
    run = _sensor(folder, text).runs[0]
    assert run.file == (tmp_path / "shared/data/a/b.mat").resolve()
    assert run.shown == "$IMUBAYES_DATA/a/b.mat"


def test_static_log_that_the_others_lean_on_is_estimated(tmp_path):
    log = RUN.replace('"tumble"', '"log"', 1)
    sensor = _sensor(tmp_path, HEAD + 'noise = { run = "log" }\n' + RUN + log)
    assert [run.noise.like for run in sensor.runs] == ["log", None]


def planned(folder: Path, procedure: str, simulate: str):
    """Plan of a simulated run."""
    run = RUN.replace('procedure = "tumble"', f'procedure = "{procedure}"')
    return plan_run(
        _sensor(folder, HEAD + run.replace('file = "run.csv"', f"simulate = {{ {simulate} }}")).runs[0]
    )


def test_tumble_with_positions_is_a_standard_set_and_without_them_turns_in_planes(tmp_path):
    assert len(planned(tmp_path, "tumble", 'positions = 26, dwell = "1 s", rate = "1 Hz"').inputs) == 26
    assert len(planned(tmp_path, "tumble", 'angles = 5, dwell = "1 s", rate = "1 Hz"').inputs) == 15


def test_tumble_with_a_latitude_has_the_earths_rate(tmp_path):
    plan = planned(tmp_path, "tumble", 'angles = 4, planes = 1, latitude = "30 deg"')
    assert plan.inputs.channels["w_i"].max() == pytest.approx(7.292115e-5 / 2.0, rel=1e-12)


def test_other_is_simulated_as_vibration_with_levels_in_any_unit_of_acceleration(tmp_path):
    plan = planned(tmp_path, "other", 'levels = ["19.6133 m/s^2"], mounts = 1')
    assert plan.procedure == "other"
    assert plan.inputs.channels["f_i"].std() == pytest.approx(2.0 * 9.80665, rel=1e-12)


def test_amplitude_of_an_oscillation_is_an_angle_and_its_frequencies_are_in_hertz(tmp_path):
    plan = planned(tmp_path, "oscillation", 'frequencies = ["2 Hz"], amplitude = "1 deg", latitude = "0 deg"')
    peak = plan.inputs.channels["w_i"].max()
    assert peak == pytest.approx(math.radians(1.0) * 2.0 * math.pi * 2.0, rel=1e-12)


STUDIES = Path(__file__).parents[2] / "studies"
KIND = {
    "accelerometer_grades": "lots",
    "basic_vs_generalized": "lots",
    "fleet": "fleet",
    "mems_vs_fog": "lots",
    "scenes": "lots",
    "scenes_accelerometers": "lots",
}


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_study_that_ships_is_of_its_kind(path):
    if path.stem.startswith("plan"):
        return
    expected = KIND.get(path.stem, SENSORS)
    assert read(path)[0] == expected
    if expected in FORMS:
        with pytest.raises(StudyError, match=rf"{expected}: {FORMS[expected].what} has no .*imubayes run"):
            read_study(path)


def test_every_kind_that_is_read_can_be_run():
    assert kinds.KINDS.keys() == {SENSORS, *FORMS}
    assert all((STUDIES / name / "__main__.py").is_file() for name in OF_THE_TOOL.values())
