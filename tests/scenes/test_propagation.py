"""Errors through a scene against a full nonlinear navigator, closed forms, invariances and Monte Carlo."""

import json
import math
from pathlib import Path

import flights
import numpy as np
import pytest
from flights import G, R
from recorded_scenes import recorded

from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.simulate import synthesise
from imubayes.scenes import Scene, from_angles, in_case
from imubayes.scenes.propagation import STATES, Budget, noise_growth, propagation
from imubayes.scenes.relevance import exposure
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import columns, library

KINDS = ("accelerometer", "gyroscope")
PATHS = ("straight", "circle", "turns", "spin", "boost")
SCHULER = math.sqrt(G / R)
UG, DPH = 1e-6 * G, math.radians(1.0) / 3600.0


def level(n, step=1.0, force=G):
    """Record of a case that lies level and does not turn."""
    up = np.tile([0.0, 0.0, force], (n, 1))
    return recorded("level", step * np.arange(n), up, np.zeros((n, 3)))


def one(kind, scene, quantity, times, schuler=True, axis=None, X=None):
    """Size (m,) of a quantity by a unit error: of a gyroscope about west, of an accelerometer northwards."""
    axis = axis or ("y" if kind == "gyroscope" else "x")
    passed = propagation(kind, scene, times, schuler=schuler)
    X = np.ones((len(scene.inputs), 1)) if X is None else X
    found = passed.read(quantity) @ passed.errors(axis, always(X))
    return np.linalg.norm(found, axis=1)[:, 0]


def always(X):
    """Columns (n, p) as those of every repetition of a record."""
    return lambda _, rows: X[rows]


def flown(kind_of_path, schuler, seconds=300.0, step=0.1):
    """Flight, and the scene that it is."""
    t = step * np.arange(round(seconds / step) + 1)
    truth = flights.flight(t, *flights.path(kind_of_path, t), level=schuler)
    scene = recorded(kind_of_path, t, truth.force, truth.rate, attitude=truth.attitude)
    return truth, scene


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("schuler", [True, False])
@pytest.mark.parametrize("kind_of_path", PATHS)
def test_every_term_on_every_axis_comes_to_what_a_full_navigator_makes_of_it(kind_of_path, schuler, kind):
    """5 %, where an effect is above what rounding and the turn of the level under way leave."""
    truth, scene = flown(kind_of_path, schuler)
    lib, n, at = library(kind, set="extended"), len(truth.t), [1000, 3000]
    if kind_of_path == "boost" and schuler:  # later it is 4,500 km away
        at = [300, 600]
    drive, expected = [], []
    passed = propagation(kind, scene, truth.t[at].tolist(), schuler=schuler)
    for axis in "xyz":
        X = columns(lib, in_case(scene.inputs, axis).channels, n)
        sizes = {"gyroscope": 1e-7, "accelerometer": 1e-3}[kind] / np.maximum(np.abs(X).max(axis=0), 1e-12)
        found = passed.errors(axis, always(X)) * sizes
        expected.append([passed.read(quantity) @ found for quantity in STATES])
        drive.append(np.einsum("np,p,a->npa", X, sizes, np.eye(3)["xyz".index(axis)]))
    error = np.concatenate(drive, axis=1)
    none = np.zeros_like(error)
    both = (error, none) if kind == "accelerometer" else (none, error)
    full = np.array([flights.errors(truth, *both, row)[0] for row in at])
    for state in range(3):
        ours = np.concatenate([np.moveaxis(part[state], 1, 2) for part in expected], axis=1)
        got = full[:, :, state, : ours.shape[2]]
        size = np.linalg.norm(got, axis=-1)
        driven = size > max(2e-2 * size.max(), 1e-9)
        off = np.linalg.norm(ours - got, axis=-1)
        assert (off[driven] <= 0.05 * size[driven]).all()
        assert driven.any() or not schuler  # in free space nothing tilts, and some paths feel no force


@pytest.mark.parametrize("kind_of_path", PATHS)
def test_terms_come_to_what_pyins_makes_of_them(kind_of_path):
    """5 % of its strapdown integration, and of its error model, where an effect is not lost beside others.

    So do those of the navigator.
    """
    told = json.loads(Path(__file__).with_name("pyins.json").read_text(encoding="utf-8"))
    here = [one for one in told["errors"] if one[0] == kind_of_path]
    t = 0.1 * np.arange(3001)
    truth = flights.flight(t, *flights.path(kind_of_path, t), level=True, follows=True)
    scene = recorded(kind_of_path, t, truth.force, truth.rate, attitude=truth.attitude)
    largest = {kind: np.max([one[5:] for one in here if one[1] == kind], axis=0) for kind in KINDS}
    compared = 0
    for _, kind, axis, term, size, *theirs in here:
        lib = library(kind, set="extended")
        X = size * columns(lib, in_case(scene.inputs, axis).channels, len(scene.inputs))
        X = X[:, [lib.names.index(term)]]
        ours = [one(kind, scene, state, told["at"], axis=axis, X=X) for state in (*STATES, *STATES[1:])]
        error = np.einsum("np,a->npa", X, np.eye(3)["xyz".index(axis)])
        both = (error, 0.0 * error) if kind == "accelerometer" else (0.0 * error, error)
        full = [flights.errors(truth, *both, round(at / 0.1))[0][0] for at in told["at"]]
        flown = np.linalg.norm(full, axis=2).T
        driven = np.array(theirs) > 0.05 * largest[kind]
        if kind_of_path == "boost":  # at 45 km/s the level turns under way, which is not followed
            driven[:, 1] = False
        compared += driven.sum()
        np.testing.assert_allclose(
            np.array(ours)[driven], np.array(theirs)[driven], rtol=0.05, err_msg=f"{kind} {axis} {term}"
        )
        if kind_of_path == "boost":  # nor flown by the navigator
            continue
        np.testing.assert_allclose(
            flown[driven[:3]], np.array(theirs)[:3][driven[:3]], rtol=0.05, err_msg=f"{kind} {axis} {term}"
        )
    assert compared > 40


@pytest.mark.parametrize("degrees", [6.0, 44.99])
def test_error_in_a_case_that_turns_as_far_as_it_may_from_row_to_row_is_followed(degrees) -> None:
    """Closed form: a bias b about an axis that turns at W comes to the chord b / W 2 sin(W t / 2)."""
    turn, n = math.radians(degrees), round(180.0 / degrees)
    rate = np.tile([0.0, 0.0, turn], (n + 1, 1))
    spin = recorded("spin", np.arange(n + 1.0), np.tile([0.0, 0.0, G], (n + 1, 1)), rate)
    passed = propagation("gyroscope", spin, [float(n)], schuler=False)
    (at,) = passed.errors("x", lambda record, rows: np.ones((n + 1, 1))[rows])
    assert np.linalg.norm(at[:3]) == pytest.approx(2.0 / turn, rel=(turn**2 / 12.0) * 1.05)
    assert turn**2 / 12.0 < 0.055


@pytest.mark.parametrize("rated", [True, False])
def test_a_case_that_turns_farther_is_refused_by_its_rate_and_without_one_by_its_attitude(rated) -> None:
    t = np.arange(9.0)
    roll = from_angles(np.radians(50.0) * t, 0.0 * t, 0.0 * t)
    known = {"w_i": np.full(9, np.radians(50.0))} if rated else {}
    scene = Scene("log", Inputs(t, {"f_k": np.full(9, G), **known}, 1.0), 9.0, attitude=roll)
    with pytest.raises(InputError, match="turns by up to 50 deg from row to row: expected 45 deg at most"):
        propagation("gyroscope", scene, [9.0])


def test_long_missions_have_the_published_magnitudes() -> None:
    """100 ug oscillate with 1.28 km peak; 0.01 deg/h on a level axis make 0.6 nautical miles an hour."""
    half = math.pi / SCHULER
    scene = level(1000, 10.0)
    # the Earth turns the level frame by a tenth of a radian in that time
    assert 100.0 * UG * one("accelerometer", scene, "position", [half])[0] == pytest.approx(1280.0, rel=0.03)
    two = one("gyroscope", scene, "position", [2.0 * half])[0] * 0.01 * DPH
    assert two / (2.0 * half) * 3600.0 / 1852.0 == pytest.approx(0.6, rel=0.05)
    assert 2.0 * half / 60.0 == pytest.approx(84.4, abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("schuler", [True, False])
def test_repeated_record_is_the_record_written_out(kind, schuler) -> None:
    _, scene = flown("turns", schuler, 59.95)
    n, times = len(scene.inputs), [30.0, 60.0, 130.0, 600.0, 615.0]
    X = np.random.default_rng(2).normal(size=(n, 3)) + 1.0
    passed = propagation(kind, scene, times, schuler=schuler)
    repeated = passed.errors("y", always(X))
    written = {name: np.tile(values, 11) for name, values in scene.inputs.channels.items()}
    t = scene.inputs.interval * np.arange(11 * n)
    long = Scene(
        "long", Inputs(t, written, scene.inputs.interval), 660.0, attitude=np.tile(scene.attitude, (11, 1, 1))
    )
    found = propagation(kind, long, times, schuler=schuler).errors("y", always(np.tile(X, (11, 1))))
    # the last row of each record is held to its end, there it goes over into the first
    assert np.abs(repeated - found).max(axis=(0, 2)) == pytest.approx(0.0, abs=2e-3 * np.abs(found).max())
    own = passed.errors("y", always(X), repeated=False)
    assert own == pytest.approx(repeated, rel=1e-9, abs=1e-9 * np.abs(repeated).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("which", [0, 1, 2])
def test_noise_growth_is_the_spread_of_simulated_missions_that_turn(kind, which) -> None:
    """A record of 200 s in S-turns, flown two and a half times: the rms of 500, to 4 standard errors."""
    _, scene = flown("turns", True, 199.5, 0.5)
    missions, time = 500, 500.0
    noise = Noise(*(1e-4 if k == which else 0.0 for k in range(3)))
    rng = np.random.default_rng(10 + which)
    t = 0.5 * np.arange(1200)
    drawn = np.column_stack([synthesise(noise, t, 0.5, rng) for _ in range(missions)])
    passed = propagation(kind, scene, [time])
    last = passed.errors("y", lambda k, rows: drawn[400 * k : 400 * (k + 1)][rows], repeated=False)[0]
    for quantity in STATES:
        expected = noise_growth(passed, "y", quantity)[which] * 1e-4
        size = math.sqrt(np.mean(np.sum((passed.read(quantity) @ last) ** 2, axis=0)))
        # time constants of the flicker lie elsewhere there: 3 % beside the chance of 500 draws
        assert size == pytest.approx(expected, rel=4.0 / math.sqrt(2.0 * missions) + 0.03)


def test_noise_of_the_output_is_what_a_second_holds() -> None:
    found = exposure(level(8), library("accelerometer"), Budget("output", 1.0)).noise
    assert found == pytest.approx((1.0, 0.6643, 2.0), rel=1e-3)
