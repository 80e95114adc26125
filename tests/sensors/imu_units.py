"""Units of whole IMUs, shared by tests."""

import numpy as np

from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import draw_unit, sensor
from imubayes.sensors.imu import COMPONENTS, Component, Imu, imu_of, kind_of
from imubayes.sensors.terms import library

TACTICAL = {kind: sensor("mems_tactical", kind=kind) for kind in ("accelerometer", "gyroscope")}


def drawn_imu(seed: int, levers=None, classes: dict[str, SensorClass] = TACTICAL, **options) -> Imu:
    """A unit of these classes by kind, with libraries of these options."""
    rng, found = np.random.default_rng(seed), {}
    for name in COMPONENTS:
        lib = library(kind_of(name), **options)
        drawn = draw_unit(classes[lib.kind], lib, rng)
        found[name] = Component(lib, np.array([drawn[term] for term in lib.names]))
    return imu_of(found, levers)
