"""IEEE 1293 and 952 there and back over the catalogue, to 1e-12 relative in every single parameter."""

import math

import numpy as np
import pytest

from imubayes.sensors.catalogue import classes
from imubayes.sensors.equations.standards import standard

FIGURES = {
    "ieee1293": {
        "s": "s", "K0": "K0", "K0p": "K0p", "K1p": "K1p", "Koq": "Koq", "K2": "K2", "K3": "K3",
        "d_o": "mis", "d_p": "mis", "Kip": "Kx", "Kio": "Kx", "Kpo": "Kx", "Kpp": "Kxx", "Koo": "Kxx",
        "Kspin": "Kspin", "Kang": "Kaa",
    },
    "ieee952": {
        "eps_K": "s", "eps_T": "T1", "eps_1": "nl2", "eps_2": "nl3", "eps_1p": "sasym", "a_X": "mis",
        "a_Y": "mis", "D_F": "b0", "D_T": "T0", "D_Tdot": "Tdot",
    },
}  # fmt: skip
"""Parameters, and the catalogue's figure that says how large each is."""

SETS = 1000
BOTH = pytest.mark.parametrize(("kind", "id"), [("accelerometer", "ieee1293"), ("gyroscope", "ieee952")])


def _sensors(kind, id, rng):
    """Sensors of every class in turn: sizes log-uniform from a hundredth of the highest figure up to it."""
    entries, parameters = classes(kind), standard(id, kind=kind).parameters
    for n in range(SETS):
        sizes = entries[n % len(entries)].coefficients
        known = {field: sizes[key][2] for field, key in FIGURES[id].items() if key in sizes}
        shares = rng.choice((-1.0, 1.0), len(known)) * 100.0 ** -rng.random(len(known))
        yield parameters(**dict(zip(known, shares * list(known.values()), strict=True)))


@BOTH
def test_1000_sensors_of_the_catalogue_survive_the_way_to_general_and_back(kind, id):
    known = standard(id, kind=kind)
    for p in _sensors(kind, id, np.random.default_rng(1)):
        back = known.from_general(known.to_general(p))
        for row in known.symbols:
            assert math.isclose(getattr(back, row.field), getattr(p, row.field), rel_tol=1e-12), row.symbol


@BOTH
def test_1000_sets_of_coefficients_survive_the_way_to_the_standard_and_back(kind, id):
    """Each coefficient is first changed by up to a factor of two: none is the image of a sensor any more."""
    known, rng = standard(id, kind=kind), np.random.default_rng(2)
    for p in _sensors(kind, id, rng):
        theta = {name: value * rng.uniform(0.5, 2.0) for name, value in known.to_general(p).items()}
        back = known.to_general(known.from_general(theta))
        for name, value in theta.items():
            assert math.isclose(back[name], value, rel_tol=1e-12), name
