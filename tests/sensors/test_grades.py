"""Numbers of the catalogue against what they were taken from."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from imubayes.sensors.catalogue import classes, sensor
from imubayes.sensors.catalogue_file import packaged_tables
from imubayes.units import factor, quantity

G = 9.80665
DEG = math.pi / 180.0
ARCSEC = DEG / 3600.0
ULPS = 1e-14
"""A few multiplications of conversion factors."""

every_class = pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")


# --- the collection that the catalogue was made from: its own names of keys, which end in units

COLLECTION = Path(__file__).parents[3] / "shared" / "catalogue" / "grades.toml"
DPH = DEG / 3600.0
SUFFIXES = {  # longest first: the SI value of what ends a key's name
    "ppm_per_dps2": 1e-6 / DEG**2, "ppm_per_dps": 1e-6 / DEG, "dph_per_dps2": DPH / DEG,
    "dph_per_Cmin": DPH * 60.0, "ug_rads2": 1e-6 * G, "ug_rtHz": 1e-6 * G, "ug_rts": 1e-6 * G,
    "deg_rth": DEG / 60.0, "dph_rth": DPH / 60.0, "ug_g2": 1e-6 / G, "ug_g3": 1e-6 / G**2,
    "dph_g2": DPH / G**2, "dph_g": DPH / G, "dph_C": DPH, "dph_G": DPH / 1e-4, "ppm_C": 1e-6,
    "ug_C": 1e-6 * G,
    "arcsec": ARCSEC, "urad": 1e-6, "ppm": 1e-6, "ug": 1e-6 * G, "mm": 1e-3, "dph": DPH, "Hz": 1.0,
}  # fmt: skip
NAMES = {
    "KRW": "K", "ARW": "N", "RRW": "K", "Q": "Q", "dither_amp": "dither_amp", "dither": "dither"
}  # fmt: skip
RATINGS = ("range_g", "range_dps", "bandwidth_Hz", "T_range_C")


@pytest.fixture(scope="module")
def collection():
    if not COLLECTION.is_file():
        pytest.skip(f"needs {COLLECTION}")
    return tomllib.loads(COLLECTION.read_text(encoding="utf-8"))


def _collected(table: dict) -> dict[str, list[float]]:
    """Figures of a class of the collection in SI, by the catalogue's key."""
    found = {}
    for name, values in table.items():
        if isinstance(values, list) and name not in (*RATINGS, "examples"):
            suffix = next(suffix for suffix in SUFFIXES if name.endswith(f"_{suffix}"))
            key = name.removesuffix(f"_{suffix}")
            found[NAMES.get(key, key)] = [value * SUFFIXES[suffix] for value in values]
    return found


@pytest.mark.parametrize(
    ("kind", "name", "unit"), [("accelerometer", "accel", G), ("gyroscope", "gyro", DEG)]
)
def test_every_number_is_that_of_the_collection(collection, kind, name, unit):
    for table in collection[name]:
        entry = sensor(table["id"], kind=kind)
        figures = {**entry.coefficients, **entry.noise}
        expected = _collected(table)
        assert figures.keys() == expected.keys(), entry.id
        if "floor" in packaged_tables()[kind][entry.id]["noise"]:
            expected["B"] = [value / math.sqrt(2.0 * math.log(2.0) / math.pi) for value in expected["B"]]
        for key, values in expected.items():
            np.testing.assert_allclose(figures[key], values, rtol=ULPS, err_msg=f"{entry.id} {key}")
        written = packaged_tables()[kind][entry.id]
        assert written["full_scale"][:3] == table["range_g" if kind == "accelerometer" else "range_dps"]
        assert entry.full_scale == pytest.approx(written["full_scale"][1] * unit, rel=ULPS)
        assert written["bandwidth"] == [*table["bandwidth_Hz"], "Hz"]
        assert entry.temperature == pytest.approx([value + 273.15 for value in table["T_range_C"]], rel=ULPS)
        assert (entry.technology, entry.grade) == (table["technology"], table["grade"])
        assert list(entry.examples) == table["examples"]


def test_scenes_and_test_equipment_are_those_of_the_collection(collection):
    ours = {scene["id"]: scene for scene in packaged_tables()["scene"]}
    theirs = {scene["id"]: scene for scene in collection["scene"]}
    assert len(ours) == 15
    numbers = [{**scene, "note": ""} for scene in ours.values()]
    assert numbers == [{**scene, "note": ""} for scene in theirs.values()]
    figures = [figure[:3] for figure in packaged_tables()["reference"]["figures"].values()]
    assert figures == list(collection["reference"].values())


# --- what a source says itself, in the source's own units

QUOTED = tomllib.loads((Path(__file__).parents[1] / "references" / "quoted.toml").read_text(encoding="utf-8"))


def _rounded(value: float) -> set[str]:
    return {f"{value:.{digits}e}" for digits in (0, 1)}


@every_class
def test_a_number_bears_a_source_only_where_the_source_says_it(entry):
    written = packaged_tables()[entry.kind][entry.id]
    figures = {**written, **written["coefficients"], **written["noise"]}
    named = {*entry.coefficients, *written["noise"], "full_scale", "bandwidth"}
    assert entry.units.keys() == entry.origins.keys() == named
    assert all(kind in written["source"] for kind in written.get("quoted", {}))
    for kind in ("datasheet", "second_hand"):
        expected = QUOTED[entry.kind].get(entry.id, {}).get(kind, {})
        places = ("low", "typical", "high")
        bearing = {
            f"{key}.{place}"
            for key, origins in entry.origins.items()
            for place, origin in zip(places, origins, strict=True)
            if origin == kind
        }
        assert bearing == expected.keys()
        for number, said in expected.items():
            key, place = number.split(".")
            *values, unit = figures[key]
            value = values[places.index(place)]
            si = quantity(said, like=unit)  # said in the source's unit
            told = si / factor(unit, like=unit)
            assert value == pytest.approx(told, rel=1e-9) or value in map(float, _rounded(told)), number


@pytest.mark.parametrize(
    ("id", "key", "size"),
    [
        ("mech_rate_spring", "crate", 0.04 / (100.0 * DEG)),  # deflection a rate
        ("mech_rate_spring", "aa", 1.0 / ((2.0 * math.pi * 25.0) ** 2 * 0.04 / (100.0 * DEG))),  # I/H, s
        ("mech_rate_spring", "nl3", 0.003 / (100.0 * DEG) ** 2),
        ("mech_rate_spring", "b0p", 0.01 * DEG),
        ("cvg_macro_tactical", "g1", None),
    ],
)
def test_orders_of_magnitude_of_our_own_follow_from_what_their_source_says(id, key, size):
    entry = sensor(id, kind="gyroscope")
    assert {kind for kinds in entry.origins.values() for kind in kinds} == {"order_of_magnitude"}
    _, typical, high = entry.coefficients[key]
    if size is None:
        assert high == pytest.approx(0.01 * DEG / G, rel=ULPS)
    else:
        assert typical == pytest.approx(size, rel=0.1)
