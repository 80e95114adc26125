"""Normal gravity against the published values of WGS-84 (NIMA TR8350.2, table 3.4) and another route."""

import math

import pytest

from imubayes.rig.plans import normal_gravity


@pytest.mark.parametrize(
    ("latitude", "published"), [(0.0, 9.7803253359), (90.0, 9.8321849378), (-90.0, 9.8321849378)]
)
def test_gravity_on_the_ellipsoid_has_its_published_values(latitude, published):
    assert normal_gravity(math.radians(latitude), 0.0) == pytest.approx(published, abs=1e-10)


def test_gravity_at_45_degrees_is_that_of_the_series_of_grs80():
    # Moritz, Geodetic Reference System 1980: series in the latitude, as rounded as its coefficients
    s, s2 = math.sin(math.radians(45.0)) ** 2, math.sin(math.radians(90.0)) ** 2
    series = 9.780327 * (1.0 + 0.0053024 * s - 0.0000058 * s2)
    assert normal_gravity(math.radians(45.0), 0.0) == pytest.approx(series, abs=5e-6)


def test_gravity_falls_by_the_free_air_gradient():
    # 0.3086 mGal/m at middle latitudes, to its four digits
    gradient = (normal_gravity(0.8, 100.0) - normal_gravity(0.8, 0.0)) / 100.0
    assert gradient == pytest.approx(-3.086e-6, rel=1e-3)
