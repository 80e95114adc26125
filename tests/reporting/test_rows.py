from dataclasses import asdict, replace

import numpy as np
import pytest
from results_found import sampled_result, sensor_result

from imubayes.reporting.rows import noise_cells, noise_draws, noise_floor
from imubayes.sensors.noise import allan_variance

G = 9.80665


def test_noise_floor_is_the_lowest_allan_deviation() -> None:
    sensor = sensor_result()
    tau = np.geomspace(1.0, 2880.0, 5000)
    lowest = min(float(np.sqrt(allan_variance(asdict(run.noise), tau).min())) for run in sensor.runs)
    assert float(noise_floor(sensor).value) == pytest.approx(lowest / (1e-6 * G), rel=0.05)


def test_noise_of_the_chains_is_printed_by_their_mean_and_sd() -> None:
    sensor = sampled_result()
    run, chains = sensor.runs[0], sensor.chains
    (N, _), _, (K, is_limit) = noise_cells(run, sensor.kind, chains)
    draws = chains.noise[:, :, 0, 0] / (1e-6 * G)
    assert noise_draws(run, chains) is not None and is_limit
    assert float(N.value) == pytest.approx(draws.mean(), abs=0.05)
    assert float(N.sd) == pytest.approx(draws.std(), rel=0.05)
    # the limit is rounded up: 95 % of the draws are below it
    below = chains.noise[:, :, 0, 2] / (1e-6 * G) < float(K.value)
    assert 0.95 <= below.mean() < 0.97
    shared = replace(sensor.runs[1], found=replace(sensor.runs[1].found, run="tumble"))
    assert noise_cells(shared, sensor.kind, chains) == noise_cells(run, sensor.kind, chains)
