"""``kind = "imu"``: what is said of both kinds at once, and what is refused."""

import numpy as np
import pytest

from imubayes.config.reading import read_runs, read_study
from imubayes.errors import DataError, StudyError
from imubayes.study import check

CHANNELS = "ax [m/s^2],ay [m/s^2],az [m/s^2]", "gx [deg/s],gy [deg/s],gz [deg/s]"

HEAD = """
[[sensor]]
id = "A"
kind = "imu"
class = { accelerometer = "mems_industrial", gyroscope = "mems_consumer" }
noise = { accelerometer = "white", gyroscope = { N = "0.01 deg/s/sqrt(Hz)" } }
[sensor.library.gyroscope]
powers = 1
set = "extended"
[sensor.prior.gyroscope]
g_i = "300 deg/h/g"
"""
RUN = """
[[sensor.run]]
name = "hand"
procedure = "free-tumble"
file = "both.csv"
gravity = "9.81 m/s^2"
"""
FERRARIS = RUN.replace("free-tumble", "ferraris")


def written(folder, text):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def record(path, channels, *, start=0.0, rows=40):
    t = start + 0.01 * np.arange(rows)
    values = np.random.default_rng(1).normal(size=(rows, 3 * len(channels)))
    header = ",".join(("t [s]", *channels))
    np.savetxt(path, np.column_stack((t, values)), delimiter=",", header=header, comments="")
    return values


def test_each_kind_has_its_own_class_library_prior_and_noise(tmp_path):
    (spec,) = read_study(written(tmp_path, HEAD + RUN)).sensors
    assert spec.gyroscope is not None
    assert (spec.kind, spec.gyroscope.kind) == ("accelerometer", "gyroscope")
    assert [one.sensor_class.id for one in (spec, spec.gyroscope)] == ["mems_industrial", "mems_consumer"]
    assert "g_i" in spec.gyroscope.library.names
    assert "b3" in spec.library.names
    assert spec.prior == {}
    assert spec.gyroscope.prior == pytest.approx({"g_i": np.deg2rad(300.0) / 3600.0 / 9.80665})
    assert spec.runs[0].noise.rule == "white"
    assert pytest.approx(np.deg2rad(0.01)) == spec.gyroscope.runs[0].noise.value.N


def test_two_files_on_one_clock_are_one_run(tmp_path):
    force, rate = (
        record(tmp_path / f"{n}.csv", [c]) for n, c in zip(("both", "rate"), CHANNELS, strict=True)
    )
    path = written(tmp_path, HEAD + RUN + 'gyroscope_file = "rate.csv"\n')
    (run,) = read_runs(path)
    np.testing.assert_allclose(run.force, force, rtol=1e-12)
    np.testing.assert_allclose(run.rate, np.deg2rad(rate), rtol=1e-12)


def test_two_clocks_are_refused(tmp_path):
    record(tmp_path / "both.csv", CHANNELS[:1])
    record(tmp_path / "rate.csv", CHANNELS[1:], start=0.005)
    path = written(tmp_path, HEAD + RUN + 'gyroscope_file = "rate.csv"\n')
    with pytest.raises(DataError, match="expected the same time stamps in both"):
        read_runs(path)


def test_section_beyond_the_file_is_refused(tmp_path):
    record(tmp_path / "both.csv", CHANNELS)
    path = written(tmp_path, HEAD + FERRARIS + 'sections = [{ rows = [30, 50], up = "x" }]\n')
    with pytest.raises(DataError, match="rows 30 to 50 are no section of a file of 40 rows"):
        read_runs(path)


def test_six_components_can_be_checked_before_the_test(tmp_path):
    record(tmp_path / "both.csv", CHANNELS, rows=90)
    ups = [*"xyz", "-x", "-y", "-z"]
    parts = [f'{{ rows = [{10 * k}, {10 * k + 10}], up = "{up}" }}' for k, up in enumerate(ups)]
    parts += [
        f'{{ rows = [{10 * k + 60}, {10 * k + 70}], up = "{up}", turn = "90 deg" }}'
        for k, up in enumerate("xyz")
    ]
    path = written(tmp_path, HEAD + FERRARIS + f"sections = [{', '.join(parts)}]\n")
    assert [one.id for one in check(read_study(path))] == ["A.ax", "A.ay", "A.az", "A.gx", "A.gy", "A.gz"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "library.gyroscope",
            "library",
            r"sensor\[0\].library.powers: unknown key: expected \[sensor.library.acc",
        ),
        ("powers = 1", "powrs = 1", r"library.gyroscope.powrs: unknown key: did you mean 'powers'"),
        (', gyroscope = "mems_consumer" }', " }", "expected one class, or { accelerometer"),
        ('gyroscope = "mems_consumer"', 'gyroscope = "mems"', "class.gyroscope: class 'mems' is not in"),
        ("free-tumble", "tumble", "'tumble' is not known for a whole IMU: expected free-tumble or ferraris"),
        ("free-tumble", "ferraris", "sections: expected the positions and turns"),
        ('g_i = "300', 'g_x = "300', "prior.gyroscope.g_x: is not a term of the library"),
        ('id = "A"', 'id = "A"\nrobust = true', "robust: is not known for a whole IMU"),
        (
            'id = "A"',
            'id = "A"\nreference = { fixture = true }',
            "leans on nothing but gravity: leave it out",
        ),
        ('kind = "imu"', 'kind = "accelerometer"', "class: expected the id of a class"),
    ],
)
def test_what_an_imu_cannot_have_is_refused_by_its_key(tmp_path, old, new, message):
    assert old in HEAD + RUN
    with pytest.raises(StudyError, match=message):
        read_study(written(tmp_path, (HEAD + RUN).replace(old, new, 1)))
