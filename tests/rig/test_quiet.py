"""Simulated quiet logs have the Allan variance of their processes."""

import numpy as np
import pytest
from quiet_logs import quiet_log

from imubayes.inference.allan import allan_deviation, log_covariance
from imubayes.sensors.noise import allan_variance

SAMPLES, INTERVAL, LOGS = 4000, 0.5, 30


@pytest.mark.parametrize(
    "noise",
    [
        {"N": 0.3},
        {"N": 1e-4, "K": 0.2},
        {"N": 1e-4, "Q": 0.4},
        {"N": 1e-4, "G": 0.5, "tau": 20.0},
        {"N": 1e-4, "G": 0.5, "tau": 0.4},
        {"N": 0.2, "Q": 0.3, "K": 0.01, "G": 0.2, "tau": 8.0},
    ],
    ids=["N", "K", "Q", "G", "fast G", "all"],
)
def test_allan_variance_of_simulated_logs_is_that_of_their_processes(noise):
    rng = np.random.default_rng(11)
    t = INTERVAL * np.arange(SAMPLES)
    curves = [allan_deviation(quiet_log(noise, SAMPLES, INTERVAL, rng), t, INTERVAL) for _ in range(LOGS)]
    tau = curves[0][0]
    shown = tau <= 0.1 * SAMPLES * INTERVAL
    mean = np.mean([deviation**2 for _, deviation in curves], axis=0)[shown]
    expected = allan_variance(noise, tau[shown])
    sd = np.sqrt(np.diag(log_covariance(noise, tau[shown], (SAMPLES, INTERVAL))) / LOGS)
    assert np.all(np.abs(mean / expected - 1.0) < 4.0 * sd)
