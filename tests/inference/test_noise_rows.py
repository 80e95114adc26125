"""Rows that noise is judged by, of a file that is read a part at a time."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet as pq
from quiet_logs import quiet_log

from imubayes.inference.linear import linear_of
from imubayes.inference.noise_rows import noise_rows
from imubayes.rig import formats, stream_survey, streams
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import class_prior
from imubayes.sensors.terms import library

SAMPLES, INTERVAL, STRETCH = 60_000, 0.1, 8192
LIB = library("gyroscope", powers=1, asymmetry=-1)
CONSUMER = sensor("mems_consumer", kind="gyroscope")
KNOWN = class_prior(CONSUMER, INTERVAL)
NOISE = {"N": KNOWN["N"][0], "B": 2.0 * KNOWN["B"][0]}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A quiet log in memory, and read a part at a time."""
    path = tmp_path_factory.mktemp("log") / "log.parquet"
    y = quiet_log(NOISE, SAMPLES, INTERVAL, np.random.default_rng(1))
    pq.write_table(pa.table({"t [s]": INTERVAL * np.arange(SAMPLES), "output [rad/s]": y}), path)
    spec = RunSpec("log", "static", file=path)
    whole = read_run(spec, "gyroscope")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(streams, "STREAMED", 1000)
        patch.setattr(formats, "ROWS", 7001)
        patch.setattr(stream_survey, "STRETCH", STRETCH)
        part = read_run(spec, "gyroscope")
    return [linear_of(run, LIB) for run in (whole, part)]


def test_pieces_of_a_stream_are_its_stretch_and_the_blocks_beside_it(runs):
    whole, part = runs
    means, _ = noise_rows(part)
    assert means.sampling == pytest.approx(INTERVAL)
    start = means.t - 0.5 * means.duration
    assert (np.diff(start) > 0.0).all()
    # a block that the stretch cuts is left out at either end
    block = part.stream.counts.max() * INTERVAL
    assert means.duration.sum() == pytest.approx(SAMPLES * INTERVAL, abs=2.0 * block)
    for k in (0, len(means) // 2, len(means) - 1):
        inside = slice(
            *np.searchsorted(whole.t + 0.5 * INTERVAL, start[k] + [1e-6, means.duration[k] + 1e-6])
        )
        assert means.y[k] == pytest.approx(whole.y[inside].mean(), rel=1e-6)
