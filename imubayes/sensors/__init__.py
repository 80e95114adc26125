"""What is tested: the model's terms, the catalogue of technologies and grades, noise processes.

A technology at a grade is a `SensorClass`: the value that the catalogue is made of, and what its keys mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from imubayes.sensors.terms import OUTPUT_UNIT, Kind

Range = tuple[float, float, float]
"""Low, typical and high over the members of a class, SI."""

PLACES = ("low", "typical", "high")

SourceKind = Literal["datasheet", "second_hand", "order_of_magnitude"]
SOURCE_KINDS: dict[SourceKind, str] = {
    "datasheet": "read in the maker's own text",
    "second_hand": "a data sheet as quoted by somebody else",
    "order_of_magnitude": "professional knowledge, not looked up",
}
"""How far a number can be trusted, the best first."""

Origins = tuple[SourceKind, SourceKind, SourceKind]
"""Source kinds of low, typical and high."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorClass:
    """A technology at a grade.

    Attributes
    ----------
    id : name in the catalogue, unique within a kind.
    kind : accelerometer or gyroscope.
    technology, grade : in words.
    examples : products of the class.
    full_scale : typical largest input, m/s^2 or rad/s.
    bandwidth : typical, Hz.
    coefficients : size of each coefficient by the catalogue's key (``K2``, ``mis``, ``g1``), SI.
    noise : size of ``N``, ``B``, ``K``, SI (see `imubayes.sensors.noise.Noise`).
    temperature : (lowest, highest) of operation, K.
    source : where the figures come from, in words.
    units : unit in which each figure is written in the catalogue, by key; of the bias instability ``B`` or
        ``floor`` is written.
    origins : source kind of each number of each figure, by key.
    note : what the figures leave out, in words; mostly empty.
    campaign : name of the test campaign that fits the class (`catalogue_file.campaign_of`); empty for none.
    """

    id: str
    kind: Kind
    technology: str
    grade: str
    examples: tuple[str, ...]
    full_scale: float
    bandwidth: float
    coefficients: Mapping[str, Range]
    noise: Mapping[str, Range]
    temperature: tuple[float, float]
    source: str
    units: Mapping[str, str]
    origins: Mapping[str, Origins]
    note: str = ""
    campaign: str = ""


@dataclass(frozen=True, slots=True)
class CatalogueKey:
    """A key of the catalogue: what it is in words, its SI unit, whether priors and simulations need it."""

    text: str
    unit: str
    required: bool = True


COEFFICIENT_KEYS: Mapping[Kind, Mapping[str, CatalogueKey]] = {
    "accelerometer": {
        "K0": CatalogueKey("bias", "m/s^2"),
        "Q": CatalogueKey("velocity quantum (rms) over the sampling interval", "m/s^2", required=False),
        "s": CatalogueKey("scale factor", "1"),
        "K0p": CatalogueKey("bias asymmetry (full difference)", "m/s^2"),
        "K1p": CatalogueKey("scale asymmetry (full difference)", "1"),
        "K2": CatalogueKey("second order", "(m/s^2)^-1"),
        "Koq": CatalogueKey("odd quadratic", "(m/s^2)^-1"),
        "K3": CatalogueKey("third order", "(m/s^2)^-2"),
        "mis": CatalogueKey("misalignment about either axis", "rad"),
        "Kx": CatalogueKey("cross-coupling", "(m/s^2)^-1"),
        "Kxx": CatalogueKey("cross-axis squares", "(m/s^2)^-1"),
        "vre": CatalogueKey("rectified vibration", "(m/s^2)^-1", required=False),
        "Kspin": CatalogueKey("spin correction", "m/s^2/(rad/s)^2"),
        "Kaa": CatalogueKey("angular acceleration", "m/s^2/(rad/s^2)"),
        "lever": CatalogueKey("offset of the sensing point", "m"),
        "T0": CatalogueKey("bias by temperature", "m/s^2/K"),
        "T1": CatalogueKey("scale by temperature", "1/K"),
        "Tdot": CatalogueKey("bias by the rate of temperature", "m/s^2/(K/s)", required=False),
    },
    "gyroscope": {
        "b0": CatalogueKey("bias", "rad/s"),
        "Qang": CatalogueKey("angle quantum (rms)", "rad", required=False),
        "s": CatalogueKey("scale factor", "1"),
        "sasym": CatalogueKey("scale asymmetry (full difference)", "1"),
        "b0p": CatalogueKey("bias asymmetry (half of the dead band)", "rad/s"),
        "nl2": CatalogueKey("nonlinearity, w^2", "(rad/s)^-1"),
        "nl3": CatalogueKey("nonlinearity, w^3", "(rad/s)^-2"),
        "mis": CatalogueKey("misalignment about either axis", "rad"),
        "crate": CatalogueKey("cross-rate products", "(rad/s)^-1"),
        "g1": CatalogueKey("linear g-sensitivity", "rad/s/(m/s^2)"),
        "g2": CatalogueKey("quadratic g-sensitivity", "rad/s/(m/s^2)^2"),
        "vre": CatalogueKey("rectified vibration", "rad/s/(m/s^2)^2", required=False),
        "aa": CatalogueKey("angular acceleration", "rad/s/(rad/s^2)"),
        "T0": CatalogueKey("bias by temperature", "rad/s/K"),
        "T1": CatalogueKey("scale by temperature", "1/K"),
        "Tdot": CatalogueKey("bias by the rate of temperature", "rad/s/(K/s)", required=False),
        "mag": CatalogueKey("bias by magnetic field", "rad/s/T", required=False),
        "lockin": CatalogueKey("half width of the lock-in band, undithered", "rad/s", required=False),
        "dither_amp": CatalogueKey("dither amplitude", "rad", required=False),
        "dither": CatalogueKey("dither frequency", "Hz", required=False),
    },
}

NOISE_KEYS: Mapping[Kind, Mapping[str, CatalogueKey]] = {
    kind: {
        "N": CatalogueKey("white noise", f"{unit}/sqrt(Hz)"),
        "B": CatalogueKey("bias instability", unit, required=False),
        "floor": CatalogueKey("lowest Allan deviation", unit, required=False),
        "K": CatalogueKey("random walk", f"{unit}/sqrt(s)"),
    }
    for kind, unit in OUTPUT_UNIT.items()
}

RATING_KEYS: Mapping[Kind, Mapping[str, CatalogueKey]] = {
    kind: {"full_scale": CatalogueKey("largest input", unit), "bandwidth": CatalogueKey("bandwidth", "Hz")}
    for kind, unit in OUTPUT_UNIT.items()
}
