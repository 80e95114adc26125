from __future__ import annotations

import warnings

import numpy as np
import pytest

from imubayes.reporting.posterior import variable_names, write_posterior


@pytest.fixture
def arviz():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the import of either line announces the other
        return pytest.importorskip("arviz")


def test_arviz_reads_back_every_draw_with_its_units(tmp_path, result, arviz) -> None:
    write_posterior(result, tmp_path / "posterior.nc")
    tree = arviz.from_netcdf(tmp_path / "posterior.nc")
    (sensor,) = result.sensors
    draws = tree["posterior"]["ACC_07"]
    assert draws.dims == ("chain", "draw", "ACC_07_term")
    np.testing.assert_array_equal(draws.values[0], sensor.draws)
    np.testing.assert_array_equal(tree["prior"]["ACC_07"].values[0], sensor.prior_draws)
    assert draws["ACC_07_term"].values.tolist() == [term.name for term in sensor.selection.terms]
    assert draws["ACC_07_unit"].values.tolist() == [term.unit for term in sensor.selection.terms]
    assert draws.attrs["sensor"] == "ACC-07"


def test_components_are_variables_named_by_id_whatever_the_id_holds(
    tmp_path, make_sensor, make_study, arviz
) -> None:
    ids = ("IMU.ax", "IMU/ax", "IMU ay é", "")
    study = make_study(*(make_sensor(name) for name in ids))
    write_posterior(study, tmp_path / "posterior.nc")
    posterior = arviz.from_netcdf(tmp_path / "posterior.nc")["posterior"]
    assert len(set(variable_names(study))) == len(ids)
    assert [posterior[name].attrs["sensor"] for name in variable_names(study)] == list(ids)


def test_writing_again_replaces_the_file(tmp_path, result) -> None:
    path = tmp_path / "posterior.nc"
    write_posterior(result, path)
    size = path.stat().st_size
    write_posterior(result, path)
    assert path.stat().st_size == size
