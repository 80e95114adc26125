import warnings
from dataclasses import replace

import numpy as np
import pytest
from results_found import sampled_result, sensor_result, study_result

from imubayes.reporting.posterior import LARGEST, variable_names, write_posterior, written_draws


@pytest.fixture
def read_back(tmp_path):
    """What ArviZ reads of the file of a study."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the import of either line announces the other
        arviz = pytest.importorskip("arviz")
    return lambda study: arviz.from_netcdf(write_posterior(study, tmp_path))


def test_arviz_reads_back_every_draw_with_its_units(result, read_back) -> None:
    tree, (sensor,) = read_back(result), result.sensors
    draws = tree["posterior"]["ACC_07"]
    assert draws.dims == ("chain", "draw", "ACC_07_term")
    np.testing.assert_array_equal(draws.values[0], sensor.draws)
    np.testing.assert_array_equal(tree["prior"]["ACC_07"].values[0], sensor.prior_draws)
    assert draws["ACC_07_term"].values.tolist() == [term.name for term in sensor.selection.terms]
    assert draws["ACC_07_unit"].values.tolist() == [term.unit for term in sensor.selection.terms]
    assert draws.attrs["sensor"] == "ACC-07"


def test_components_are_variables_named_by_id_whatever_the_id_holds(read_back) -> None:
    ids = ("IMU.ax", "IMU/ax", "IMU ay é", "")
    study = study_result(*(sensor_result(name) for name in ids))
    posterior = read_back(study)["posterior"]
    assert len(set(variable_names(study))) == len(ids)
    assert [posterior[name].attrs["sensor"] for name in variable_names(study)] == list(ids)


def test_component_with_chains_fills_every_group_with_its_own_draws(read_back) -> None:
    sensor = sampled_result()
    tree, chains = read_back(study_result(sensor)), sensor.chains
    posterior = tree["posterior"]
    assert posterior.sizes["chain"] == 4
    # 600 model-averaged draws give 150 for each of four chains
    kept = np.linspace(0, 499, 150).round().astype(int)
    np.testing.assert_array_equal(posterior["ACC_07"].values.reshape(600, -1), sensor.draws)
    assert posterior["ACC_07_full"].sel(ACC_07_column="gravity").shape == (4, 150)
    assert posterior["ACC_07_noise"].dims == ("chain", "draw", "ACC_07_run", "noise")
    for group, name, drawn in (
        ("posterior", "full", chains.theta[:, kept]),
        ("posterior", "noise", chains.noise[:, kept]),
        ("sample_stats", "lp", chains.log_density[:, kept]),
        ("prior", "full", chains.prior_theta[None, :600]),
        ("prior", "noise", chains.prior_noise[None, :600]),
    ):
        np.testing.assert_array_equal(tree[group][f"ACC_07_{name}"].values, drawn)
    np.testing.assert_array_equal(tree["posterior_predictive"]["ACC_07"].values, chains.predicted[:, kept])


def test_dwells_have_their_run_and_times_and_units_stand_beside_every_column(read_back) -> None:
    sensor = sampled_result()
    tree = read_back(study_result(sensor))
    observed, full = tree["observed_data"]["ACC_07"], tree["posterior"]["ACC_07_full"]
    np.testing.assert_array_equal(observed.values, sensor.chains.observed)
    coordinates = (observed[f"ACC_07_dwell_{name}"].values.tolist() for name in ("run", "start", "stop"))
    assert tuple(zip(*coordinates, strict=True)) == sensor.chains.dwells
    assert tuple(full["ACC_07_column_unit"].values.tolist()) == sensor.chains.units
    assert full.attrs["units"].endswith("fixture_j.tumble.2: rad") and observed.attrs["units"] == "m/s^2"
    assert tree["posterior"]["ACC_07_noise_unit"].values.tolist()[0] == "m/s^2/sqrt(Hz)"


def test_components_of_any_shape_share_one_file_cut_to_the_smallest(read_back) -> None:
    one, two = sampled_result("A"), sampled_result("B")
    drawn = ("theta", "noise", "log_density", "log_likelihood", "predicted")
    part = replace(two.chains, **{name: getattr(two.chains, name)[:3, :100] for name in drawn})
    posterior = read_back(study_result(one, replace(two, chains=part), sensor_result("C")))["posterior"]
    assert (posterior.sizes["chain"], posterior.sizes["draw"]) == (3, 100)
    assert {"A_full", "B_full", "C"} <= set(posterior.data_vars) and "C_full" not in posterior.data_vars
    # a thinned chain reaches from its first draw to its last
    np.testing.assert_array_equal(posterior["A_full"].values[:, -1], one.chains.theta[:3, -1])


def test_file_of_many_components_keeps_fewer_draws_and_stays_small(tmp_path) -> None:
    one, two = sampled_result("A"), sensor_result("B")
    many = replace(two, draws=np.tile(two.draws, (200, 1)), prior_draws=np.tile(two.prior_draws, (200, 1)))
    study = study_result(replace(one, chains=None), *(many for _ in range(2)))
    assert written_draws(study) == 600
    study = study_result(many, many)
    write_posterior(study, tmp_path)
    assert 10_000 < written_draws(study) < 120_000
    assert (tmp_path / "posterior.nc").stat().st_size < 1.1 * LARGEST
