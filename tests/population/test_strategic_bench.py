from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imubayes.campaign.preparation import prepare
from imubayes.population.lots import lot_of, spec_of
from imubayes.population.records import simulate_unit
from imubayes.selection.decision import loose_fit
from imubayes.sensors.catalogue import sensor
from imubayes.study.schema import read

SCENES = read(Path(__file__).parents[2] / "studies" / "scenes.toml")[1]
ARCSECOND = np.pi / 180.0 / 3600.0


@pytest.mark.parametrize(
    ("class_id", "arcseconds", "number"), [("ifog_strategic", 5, 2), ("hrg_navigation", 20, 4)]
)
def test_errors_of_a_bench_settle_where_they_are_thousands_of_times_the_noise(class_id, arcseconds, number):
    """Plain relinearisation runs astray here; the coefficients must be the truth within their own sds."""
    study = replace(
        SCENES,
        classes=(sensor(class_id, kind="gyroscope"),),
        reference={**SCENES.reference, "fixture": arcseconds * ARCSECOND},
    )
    lot = lot_of(study, 0)
    spec = replace(spec_of(study, study.classes[0]), truth=lot.truth(number))
    runs = simulate_unit(spec, lot, number, np.random.default_rng(7))
    ready = prepare(spec, runs, lambda message: None, np.random.default_rng(8))
    mean, cov = loose_fit(ready.summary, ready.prior)
    p = len(study.library.terms)
    off = (mean[:p] - lot.theta[number]) / np.sqrt(np.diag(cov)[:p])
    # of 20 standard normals one in 12,000 sets holds one beyond 4.5
    assert np.abs(off).max() < 4.5
    assert off @ off / p < 2.5
