import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from block_readings import rows
from results_found import sampled_result, sensor_result, study_result

from imubayes.inference.noise_model import NoiseEstimate
from imubayes.reporting.rows import noise_cells, noise_draws, noise_floor, range_texts
from imubayes.reporting.views import shown_sensors, term_blocks
from imubayes.sensors.noise import allan_variance

G = 9.80665


def test_noise_that_the_data_do_not_show_is_a_limit_and_given_noise_has_no_error_bar() -> None:
    run = sensor_result().runs[0]
    cells = noise_cells(run, "accelerometer")
    assert [limit for _, limit in cells] == [False, False, True]
    # 0.4 ug/sqrt(s) times exp(1.645 * 1.4), rounded up
    assert str(cells[2][0]) == "4.1 µg/√s"
    given = noise_cells(replace(run, found=NoiseEstimate(run.noise)), "accelerometer")
    assert [cell.sd for cell, _ in given] == ["", "", ""]


def test_noise_floor_is_the_lowest_allan_deviation() -> None:
    sensor = sensor_result()
    tau = np.geomspace(1.0, 2880.0, 5000)
    lowest = min(float(np.sqrt(allan_variance(asdict(run.noise), tau).min())) for run in sensor.runs)
    assert float(noise_floor(sensor).value) == pytest.approx(lowest / (1e-6 * G), rel=0.05)


def test_ranges_are_printed_in_units_that_people_use() -> None:
    ranges = {"f_i": (-20.0 * G, 20.0 * G), "w_j": (0.0, math.pi), "T": (293.15, 299.15), "dT": (0.0, 0.1)}
    run = replace(sensor_result().runs[0], ranges=ranges)
    assert tuple(range_texts(run, "accelerometer")) == (
        ("f_i", "-20", "20", "g"),
        ("w_j", "0", "180", "deg/s"),
        ("T", "20", "26", "degC"),
        ("dT", "0.0", "6.0", "degC/min"),
    )


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


def test_partners_of_a_term_on_the_test_bench_are_shown_by_kind_once() -> None:
    sensor = sampled_result()
    partners = ("m_j", "fixture_j.tumble.1", "fixture_j.tumble.2", "gravity")
    terms = tuple(
        replace(term, confounded_with=partners) if term.name == "m_k" else term
        for term in sensor.selection.terms
    )
    changed = replace(sensor, selection=replace(sensor.selection, terms=terms))
    shown = shown_sensors(study_result(changed))
    (cells,) = (row for row in rows(term_blocks(shown[0])) if row[0] == "m_k")
    assert cells[-1] == "d_o, fixture, gravity"
