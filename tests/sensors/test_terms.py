"""The model equation, held against the slides' matrix form written out a second time."""

import numpy as np
import pytest

from imubayes.sensors.terms import CHANNEL_UNITS, Library, columns, library
from imubayes.units import factor

KINDS = ("accelerometer", "gyroscope")
ROWS = 200
CHANNELS = [f"{quantity}_{axis}" for quantity in ("f", "w", "dw") for axis in "ijk"]


def _inputs(seed: int) -> dict[str, np.ndarray]:
    """Random inputs of both signs, a tenth of them exactly zero, and a wandering temperature."""
    rng = np.random.default_rng(seed)
    channels = {name: rng.normal(0.0, 5.0, ROWS) * (rng.random(ROWS) > 0.1) for name in CHANNELS}
    heat = {"T": rng.uniform(250.0, 350.0, ROWS), "dT": rng.normal(0.0, 0.1, ROWS)}
    return {**channels, **heat, "gT": rng.normal(0.0, 3.0, ROWS)}


def _matrix_form(kind: str, theta: dict[str, float], channels: dict[str, np.ndarray]) -> np.ndarray:
    """Evaluate ``sum b_n u^n + sum b_n' sgn(u) u^n + m'u + u'C u + v'S v + g'v + s'dw`` row by row.

    The vector u is the component's own quantity and v the opposite one; C and S are upper triangular.
    """

    def of(name: str) -> float:
        return theta.get(name, 0.0)

    f, w, dw = (
        np.array([channels[f"{quantity}_{axis}"] for axis in "ijk"]).T for quantity in ("f", "w", "dw")
    )
    own, opposite = (f, w) if kind == "accelerometer" else (w, f)
    m = np.array([0.0, of("m_j"), of("m_k")])
    C = np.array([[0.0, of("c_ij"), of("c_ik")], [0.0, of("c_jj"), of("c_jk")], [0.0, 0.0, of("c_kk")]])
    S = np.array(
        [[of("S_ii"), of("S_ij"), of("S_ik")], [0.0, of("S_jj"), of("S_jk")], [0.0, 0.0, of("S_kk")]]
    )
    g = np.array([of("g_i"), of("g_j"), of("g_k")])
    s = np.array([of("s_i"), of("s_j"), of("s_k")])
    y = np.zeros(len(f))
    for n in range(13):
        y += of(f"b{n}") * own[:, 0] ** n
        y += of(f"b{n}p") * np.sign(own[:, 0]) * own[:, 0] ** n
    y += own @ m + np.einsum("ra,ab,rb->r", own, C, own)
    y += np.einsum("ra,ab,rb->r", opposite, S, opposite) + opposite @ g + dw @ s
    return y


def _libraries() -> list[Library]:
    return [
        library(kind, powers=powers, asymmetry=asymmetry, set=set)
        for kind in KINDS
        for set in ("slide", "extended")
        for powers, asymmetry in ((1, -1), (3, 2), (6, 5))
    ]


@pytest.mark.parametrize("lib", _libraries(), ids=lambda lib: f"{lib.kind}-{len(lib.terms)}")
def test_every_column_is_its_place_in_the_matrix_form(lib):
    channels = _inputs(seed=1)
    X = columns(lib, channels, ROWS)
    for j, name in enumerate(lib.names):
        expected = _matrix_form(lib.kind, {name: 1.0}, channels)
        assert expected.any()
        np.testing.assert_allclose(X[:, j], expected, rtol=1e-13, atol=0.0, err_msg=name)


@pytest.mark.parametrize("kind", KINDS)
def test_temperature_terms_are_their_base_times_powers_of_the_deviation(kind):
    channels = _inputs(seed=4)
    lib = library(kind, temperature=3, temperature_of=("b0", "b1", "c_jk"))
    X = dict(zip(lib.names, columns(lib, channels, ROWS).T, strict=True))
    deviation = channels["T"] - 298.15
    for base in ("b0", "b1", "c_jk"):
        for q, suffix in ((1, ""), (2, "2"), (3, "3")):
            expected = X[base] * deviation**q
            np.testing.assert_allclose(X[f"{base}*T{suffix}"], expected, rtol=1e-13, err_msg=base)
    np.testing.assert_array_equal(X["b0*dT"], channels["dT"])


@pytest.mark.parametrize(("asked", "by"), [("rate_of", "dT"), ("gradient_of", "gT")])
@pytest.mark.parametrize("kind", KINDS)
def test_terms_by_rate_and_gradient_are_their_base_times_these(kind, asked, by):
    channels, bases = _inputs(seed=5), ("b0", "b1", "b1p", "m_k", "c_jk")
    lib = library(kind, temperature=1, temperature_of=(), **{"rate_of": (), asked: bases})
    assert [term.name for term in lib.terms if term.group == "temperature"] == [f"{b}*{by}" for b in bases]
    X = dict(zip(lib.names, columns(lib, channels, ROWS).T, strict=True))
    for base in bases:
        # products in another order of factors: one rounding each
        np.testing.assert_allclose(X[f"{base}*{by}"], X[base] * channels[by], rtol=1e-15, err_msg=base)
    assert not any("dT" in name for name in library(kind, temperature=2, rate_of=()).names)
    assert library(kind, rate_of=bases).names == library(kind).names


def test_slide_set_is_exactly_the_slides_terms():
    shared = "b0 b1 b2 b3 b0p b1p b2p m_j m_k c_ij c_ik c_jj c_jk c_kk S_ij S_ik S_jk"
    assert " ".join(library("accelerometer").names) == f"{shared} s_i s_j s_k"
    assert " ".join(library("gyroscope").names) == shared


@pytest.mark.parametrize("kind", KINDS)
def test_printed_unit_measures_the_coefficient_that_the_si_unit_does(kind):
    base = "m/s^2" if kind == "accelerometer" else "rad/s"
    names = library(kind, powers=6, asymmetry=5, set="extended").names
    for term in library(
        kind, powers=6, asymmetry=5, set="extended", temperature=2, temperature_of=names, rate_of=names
    ).terms:
        assert factor(term.unit, like=term.unit) == pytest.approx(1.0, rel=1e-15), term.name
        assert factor(term.printed, like=term.unit) > 0.0
        regressor = [f"({CHANNEL_UNITS[part.channel.split('_')[0]]})^{part.power}" for part in term.factors]
        product = "*".join([f"({term.unit})", *regressor])
        assert factor(product, like=base) == pytest.approx(1.0, rel=1e-15), product
