"""A simulated study, written as files, is the same study."""

import json
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.campaign.preparation import simulate_sensor
from imubayes.rig.runs import read_run
from imubayes.study.schema import read_study, record_study, toml_lines

STUDY = """
[study]
title = "two \\"sensors\\""
seed = 7
method = "collapsed"
[sampling]
ess = 400.5
time_limit = "20 s"
[[appendix]]
title = "speed"
file = "tables/speed.csv"

[[sensor]]
id = "A/1"
kind = "accelerometer"
class = "mems_tactical"
noise = { run = "log" }
robust = true
unit = "A"
session = "1"
reference = { gravity = true, fixture = "20 arcsec", table_zero = false }
[sensor.library]
powers = 2
[sensor.truth]
b0 = "1.5 mg"
[[sensor.run]]
name = "log"
procedure = "static"
simulate = { duration = "20 s", rate = "5 Hz", up = [0, 0, 1] }
[[sensor.run]]
name = "tumble, cold"
procedure = "tumble"
simulate = { angles = 4, planes = 1, dwell = "1 s" }

[[sensor]]
id = "G"
kind = "gyroscope"
class = "fog_tactical"
[[sensor.run]]
name = "log"
procedure = "rate-table"
simulate = { rates = ["1 deg/s", "-10 deg/s"], mounts = 2, dwell = "1 s" }
[[sensor.run]]
name = "kept"
procedure = "static"
file = "kept.csv"
"""


@pytest.fixture
def study(tmp_path):
    (tmp_path / "two.toml").write_text(STUDY)
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "speed.csv").write_text("sampler,ESS/s\na,430\n")
    return read_study(tmp_path / "two.toml")


@pytest.fixture
def recorded(study, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    files = record_study(study, folder)
    assert sorted(file.name for file in files) == sorted(path.name for path in folder.iterdir())
    return read_study(folder / "two.toml")


def test_recorded_study_holds_the_simulated_runs_to_the_last_bit(study, recorded):
    for k, (before, after) in enumerate(zip(study.sensors, recorded.sensors, strict=True)):
        assert (after.id, after.kind, after.library) == (before.id, before.kind, before.library)
        runs, _ = simulate_sensor(before, study.seed, k)
        specs = {spec.name: spec for spec in after.runs}
        for run in runs:
            np.testing.assert_array_equal(read_run(specs[run.name], after.kind).output, run.output)


def test_recorded_study_keeps_what_was_not_simulated(study, recorded, tmp_path):
    assert (recorded.sampling, recorded.appendices) == (study.sampling, study.appendices)
    for before, after in zip(study.sensors, recorded.sensors, strict=True):
        assert (after.reference, after.robust) == (before.reference, before.robust)
        assert (after.unit, after.session) == (before.unit, before.session)
    assert (recorded.title, recorded.seed) == (study.title, study.seed)
    assert [run.noise for run in recorded.sensors[0].runs] == [run.noise for run in study.sensors[0].runs]
    assert recorded.sensors[1].runs[1].file == (tmp_path / "kept.csv").resolve()
    assert not recorded.sensors[0].truth


def test_truth_is_what_the_runs_were_made_of(study, recorded):
    truth = json.loads(recorded.path.with_name("truth.json").read_text())
    assert truth["A/1"] == study.sensors[0].truth
    assert truth["G"] == simulate_sensor(study.sensors[1], study.seed, 1)[1]


_SCALARS = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=9),
)
_KEYS = st.text(max_size=5)
_TABLES = st.recursive(
    st.dictionaries(_KEYS, st.one_of(_SCALARS, st.lists(_SCALARS, max_size=3)), max_size=3),
    lambda inner: st.dictionaries(
        _KEYS, st.one_of(_SCALARS, inner, st.lists(inner, min_size=1, max_size=3)), max_size=3
    ),
    max_leaves=8,
)


@given(_TABLES)
def test_written_toml_reads_back(tables):
    assert tomllib.loads("\n".join(toml_lines(tables))) == tables
