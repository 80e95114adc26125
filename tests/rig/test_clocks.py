"""Clocks as loggers write them tell the time at which the samples were taken."""

import numpy as np
import pytest
from run_files import csv_of

from imubayes.errors import DataError
from imubayes.rig import streams, texts
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.study.schema.run_tables import columns_of
from imubayes.study.schema.shapes import Place

N = 400
OUTPUT = np.random.default_rng(1).standard_normal(N)
SECONDS = 5.0 + 0.01 * np.arange(N)
NANOSECONDS = 1_403_636_579_758_555_392 + 10_000_000 * np.arange(N, dtype=np.int64)


def specs(**said):
    return columns_of(said, ("t", "output"), "m/s^2", Place("study.toml", "columns"))


def read(path, lines, header="t [s],output [m/s^2]\n", **said):
    path.write_text(
        header + "".join(f"{line},{y!r}\n" for line, y in zip(lines, OUTPUT.tolist(), strict=True))
    )
    return read_run(RunSpec("log", "static", path, path.name, columns=specs(**said)), "accelerometer")


ISO = [f"{stamp}Z" for stamp in np.array(NANOSECONDS, dtype="M8[ns]").astype("M8[ms]")]
PAIRS = [f"{stamp // 10**9},{stamp % 10**9}" for stamp in NANOSECONDS.tolist()]
DATES = [stamp.rstrip("Z").replace("T", ",") for stamp in ISO]


@pytest.mark.parametrize(
    ("lines", "header", "t"),
    [
        ([""] * N, "spare,output [m/s^2]\n", {"rate": "100 Hz"}),
        (NANOSECONDS.tolist(), "#timestamp [ns],output [m s^-2]\n", "timestamp"),
        (PAIRS, "sec,nsec,output [g]\n", [{"column": "sec", "unit": "s"}, {"column": "nsec", "unit": "ns"}]),
        (ISO, "t,output [g]\n", "t"),
        (DATES, "date,time,output [g]\n", ["date", "time"]),
        (ISO, "", 0),
    ],
    ids=["rate", "behind a comment", "two columns", "ISO", "date and time", "ISO without a header"],
)
@pytest.mark.parametrize("part", [10**6, 70], ids=["whole", "in parts"])
def test_time_is_that_of_even_samples(lines, header, t, part, tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "STREAMED", part)
    monkeypatch.setattr(texts, "TEXT_BLOCK", 2000)
    columns = {"t": t} if header else {"t": t, "output": {"column": 1, "unit": "g"}}
    path = tmp_path / "run.csv"
    run = read(path, lines, header, **columns)
    np.testing.assert_allclose(run.t - run.t[0], 0.01 * np.arange(N), rtol=0, atol=1e-9)
    if part < N:
        parts = RunSpec("log", "static", path, path.name, columns=specs(**columns))
        stream = read_run(parts, "accelerometer").stream
        t = np.concatenate([one.t for one in stream.parts("")])
        np.testing.assert_allclose(t - t[0], 0.01 * np.arange(N), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("interval", "resolution"), [(0.01, 0.1), (0.01, 1.0), (1.0 / 128.0, 1e-3), (1.0 / 1100.0, 1e-3)]
)
def test_rows_of_a_coarse_clock_are_spread_evenly(interval, resolution, tmp_path):
    true = 1e9 + interval * np.arange(N)
    true[300:] += 7.3  # a gap stays a gap
    run = read(tmp_path / "run.csv", [f"{np.floor(s / resolution) * resolution:.3f}" for s in true])
    assert any("spread evenly" in note for note in run.source.notes)
    assert run.interval == pytest.approx(interval, rel=resolution / interval / N)
    error = run.t - run.t[0] - (true - true[0])
    assert np.abs(error).max() <= 1.1 * resolution
    assert np.count_nonzero(np.diff(run.t) > 2.0 * interval) == 1


def test_clock_with_dropped_rows_is_no_coarse_one(tmp_path):
    dropped = np.delete(SECONDS, [50, 200])
    path = csv_of(tmp_path, "t [s],output [g]", np.column_stack((dropped, OUTPUT[2:])))
    run = read_run(RunSpec("log", "static", path), "accelerometer")
    np.testing.assert_allclose(run.t, dropped)


def test_clock_that_is_set_back_cuts_the_file_there(tmp_path):
    back = SECONDS.copy()
    back[150:] -= 1.5
    run = read(tmp_path / "run.csv", back.tolist())
    np.testing.assert_array_equal(run.t, back[150:])
    np.testing.assert_array_equal(run.output, OUTPUT[150:])
    assert any("line 152" in note and "rows 150 to 399 of 400" in note for note in run.source.notes)
    back = SECONDS.copy()
    back[[150, 151]] = back[[151, 150]]
    with pytest.raises(DataError, match="goes back"):
        read(tmp_path / "run.csv", back.tolist())


def test_counts_are_told_to_give_a_scale(tmp_path):
    scaled = {"column": "adc", "unit": "count", "scale": "1/16384 g/count"}
    counts = [f"{second!r},{k % 7}" for k, second in enumerate(SECONDS.tolist())]
    for unit in ("", " [count]"):
        with pytest.raises(DataError, match=r'scale = "1/16384 g/count"'):
            read(tmp_path / "run.csv", counts, f"t [s],adc{unit},spare\n", output="adc")
    run = read(tmp_path / "run.csv", counts, "t [s],adc,spare\n", output=scaled)
    np.testing.assert_allclose(run.output, 9.80665 / 16384 * (np.arange(N) % 7))


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_channels_by_samples_are_turned(suffix, tmp_path):
    path, values = tmp_path / f"log.{suffix}", np.vstack((SECONDS, OUTPUT))
    np.savez(path, log=values) if suffix == "npz" else np.save(path, values)
    columns = specs(t={"column": "log[:,0]", "unit": "s"}, output={"column": "log[:,1]", "unit": "g"})
    run = read_run(RunSpec("log", "static", path, columns=columns), "accelerometer")
    np.testing.assert_array_equal(run.t, SECONDS)
