"""A table of means of positions calibrates like the samples behind it."""

import numpy as np
import pytest
from run_files import csv_of

from imubayes.algebra.factor import least_squares, reorder
from imubayes.errors import DataError
from imubayes.inference.case import TriadSpec
from imubayes.inference.dwells import whitened_factor
from imubayes.inference.free_tumble import solve_free_tumble
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.triad import triad_of
from imubayes.rig import streams
from imubayes.rig.recordings import RUN_CHANNELS, RunSpec
from imubayes.rig.runs import read_imu_run, read_run
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library
from imubayes.study.schema.run_tables import columns_of
from imubayes.study.schema.shapes import Place

G = 9.81
LIBRARY = library("accelerometer", powers=1, asymmetry=0)


def table(folder, **columns):
    return csv_of(folder, ",".join(columns), np.column_stack(list(columns.values())))


def specs(**said):
    return columns_of(said, RUN_CHANNELS, "m/s^2", Place("study.toml", "columns"))


@pytest.mark.parametrize("held", [1_000_000, 10])
@pytest.mark.parametrize("column", ["dwell [s]", "n", "sd [m/s^2]"])
def test_means_are_weighed_by_what_the_table_says_however_long_it_is(column, held, tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "STREAMED", held)
    rng = np.random.default_rng(4)
    angle, given = np.deg2rad(np.arange(0.0, 360.0, 15.0)), rng.uniform(20.0, 80.0, 24)
    f_i, f_j = G * np.cos(angle), G * np.sin(angle)
    output = 1.001 * f_i + 0.02 + 0.003 * f_j + 1e-3 * rng.standard_normal(24)
    inputs = {"f_i [m/s^2]": f_i, "f_j [m/s^2]": f_j, "output [m/s^2]": output}
    path = table(tmp_path, **inputs, **{column: given})
    said = specs(dwell={"column": "n", "unit": "count", "scale": "0.01 s/count"}) if column == "n" else {}
    run = read_run(
        RunSpec("a", "tumble", path, columns=said, dwell=60.0 if column[0] == "s" else 0.0), "accelerometer"
    )
    rows = linear_of(run, LIBRARY)
    found = least_squares(reorder(whitened_factor(rows, Noise(1e-3, 0.0, 0.0)), ("b0", "b1", "m_j")))
    # second route: weighted least squares
    w = given**-2.0 if column[0] == "s" else given
    X = np.column_stack((np.ones(24), f_i, f_j))
    np.testing.assert_allclose(
        found.mean, np.linalg.solve(X.T * w @ X, X.T * w @ (output - f_i)), rtol=1e-8, atol=1e-12
    )
    assert (np.diff(rows.t) >= 0.5 * (rows.duration[1:] + rows.duration[:-1]) * (1.0 - 1e-12)).all()


def free_table(folder, rng):
    up = rng.standard_normal((40, 3))
    up *= G / np.linalg.norm(up, axis=1)[:, None]
    dwell = rng.uniform(5.0, 60.0, 40)
    # lower triangle: x lies where the case's x does
    gain, bias = np.array([[1.002, 0.0, 0.0], [0.003, 0.999, 0.0], [-0.002, 0.001, 1.001]]), [0.1, -0.2, 0.05]
    noise = 1e-3 * rng.standard_normal((40, 3)) / np.sqrt(dwell)[:, None]
    output = up @ gain.T + bias + noise
    names = [f"a{axis} [m/s^2]" for axis in "xyz"]
    return table(folder, **dict(zip(names, output.T, strict=True)), **{"dwell [s]": dwell}), gain, bias


def test_rows_of_a_free_tumbles_means_are_its_stills(tmp_path):
    path, gain, bias = free_table(tmp_path, np.random.default_rng(5))
    run = read_run(RunSpec("hand", "free-tumble", path, gravity=G), "accelerometer")
    wide = {"b0": 1.0, "b1": 0.1, "m_j": 0.1, "m_k": 0.1}
    terms = [term for part in triad_of(LIBRARY).libraries for term in part.terms]
    sd = ScalePrior([wide.get(term.name, 1e-9) for term in terms])
    case = solve_free_tumble([run], TriadSpec(LIBRARY, sd, sensor("mems_tactical", kind="accelerometer")))
    triad = case.triads[0]
    # rotation of the case is free: lengths of compensated outputs are what the table determines
    f = np.random.default_rng(6).standard_normal((20, 3))
    f *= G / np.linalg.norm(f, axis=1)[:, None]
    compensated = triad.compensate(f @ gain.T + bias)
    np.testing.assert_allclose(np.linalg.norm(compensated, axis=1), G, rtol=0, atol=1e-3)
    stills = case.summary.runs[0].stills
    assert len(stills) == 40 and stills[0][1] - stills[0][0] == pytest.approx(run.inputs.averaged[0])


def test_means_that_lack_the_turns_are_refused(tmp_path):
    units = {f"a{c}": "g" for c in "xyz"} | {f"g{c}": "deg/s" for c in "xyz"} | {"dwell": "s"}
    rows = np.random.default_rng(5).uniform(1.0, 2.0, (7, 9))
    path = table(tmp_path, **{f"{c} [{u}]": v for (c, u), v in zip(units.items(), rows, strict=True)})
    with pytest.raises(DataError, match="does not hold the turns"):
        read_imu_run(RunSpec("a", "free-tumble", path, gravity=G))
