"""Gyroscopes alone, turned by hand between positions in which up is known: simulated, and by scipy."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imubayes.algebra.factor import posterior
from imubayes.errors import UnobservableError
from imubayes.inference.case import Asked
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.known_quantities import recover
from imubayes.inference.prior import ScalePrior
from imubayes.rig.inputs import Inputs, Run, Section
from imubayes.sensors.imu import GYROSCOPES
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library, library

SDS = {"b0": 1e-2, "b1": 2e-2, "m_j": 2e-2, "m_k": 2e-2}
LIBRARY = Library("gyroscope", tuple(t for t in library("gyroscope", powers=1).terms if t.name in SDS))
WIDE = np.tile(list(SDS.values()), 3)
NOISE = Noise(2e-4, 0.0, 0.0)
HOLD, TURN, INTERVAL = 400, 300, 0.005
UP = ["x", "y", "z", "-x", "-y", "z", "x", "-z", "y", "x", "-y", "-z", "-x"]


@cache
def by_hand(seed, positions=13, tilt=0.0):
    """Cube that is laid on one face after the other, by a hand that wanders; and its coefficients."""
    rng = np.random.default_rng([seed, 5])
    theta = WIDE * rng.normal(size=12)
    # rows of the gain along x y z, from b1 m_j m_k along i j k of each component
    rows = np.array([np.roll(part[1:], k) for k, part in enumerate(theta.reshape(3, 4))])
    rates, sections, here, first = [], [], Rotation.identity(), 0
    s, step = np.arange(1, TURN) / TURN, 1e-4
    for k, up in enumerate(UP[:positions]):
        lies = Section(0, 1, up).direction
        lies = Rotation.from_rotvec(tilt * rng.normal(size=3)).apply(lies)
        # case to lab: what points up is turned to z, and about that the face is laid down anyhow
        there = Rotation.align_vectors([[0.0, 0.0, 1.0]], [lies])[0]
        there = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * there
        if k:
            way = here.inv() * there  # in axes of the case
            axis = rng.normal(size=3)

            def path(s, here=here, way=way, axis=axis):
                wander = Rotation.from_rotvec(np.outer(np.sin(np.pi * s) ** 2, axis))
                course = 10 * s**3 - 15 * s**4 + 6 * s**5
                return here * Rotation.from_rotvec(np.outer(course, way.as_rotvec())) * wander

            turned = (path(s - step).inv() * path(s + step)).as_rotvec()
            rates.append(turned / (2.0 * step * TURN * INTERVAL))
            first += TURN - 1
        rates.append(np.zeros((HOLD, 3)))
        sections.append(Section(first, first + HOLD, up))
        first, here = first + HOLD, there
    w = np.concatenate(rates)
    output = w + w @ rows.T + theta[[0, 4, 8]] + NOISE.N / np.sqrt(INTERVAL) * rng.normal(size=w.shape)
    inputs = Inputs(INTERVAL * np.arange(len(w)), {}, INTERVAL)
    return Run(
        "cube", "ferraris", inputs, output, gravity=9.81, sections=tuple(sections), components=GYROSCOPES
    ), theta


def solved(run, fixture=None):
    asked = Asked(LIBRARY, ScalePrior(WIDE), None, {"cube": NoiseRule("fixed", NOISE)})
    case = solve_ferraris([run], asked, fixture=fixture)
    sd = np.append(WIDE, [extra.sd for extra in case.summary.extras])
    return case, *posterior(case.summary.factor, sd), sd


@pytest.mark.parametrize("tilt", [0.0, 5e-3])
def test_coefficients_are_off_by_what_their_error_bars_say(tilt):
    pulls = []
    for seed in range(30):
        run, theta = by_hand(seed, tilt=tilt)
        _, mean, sd, _ = solved(run, tilt or None)
        pulls.append((mean[:12] - theta) / sd[:12])
    assert np.abs(pulls).max() < 4.5
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * 360.0))


def test_least_squares_on_where_up_is_carried_finds_the_same():
    run, _ = by_hand(1)
    t, stills = run.t, [(s.start, s.stop) for s in run.sections]
    ups = [s.direction for s in run.sections]

    def missed(x):
        gain = np.eye(3) + [np.roll(part[1:], k) for k, part in enumerate(x.reshape(3, 4))]
        w = np.linalg.solve(gain, (run.output - x[[0, 4, 8]]).T).T
        left = [x / WIDE, *(run.output[a:b].mean(axis=0) - x[[0, 4, 8]] for a, b in stills)]
        left[1:] = [one / (NOISE.N / np.sqrt(HOLD * INTERVAL)) for one in left[1:]]
        for k in range(len(stills) - 1):
            a, b = stills[k][1] - 1, stills[k + 1][0] + 1
            mean, up = 0.5 * (w[a : b - 1] + w[a + 1 : b]) * INTERVAL, ups[k]
            turns = Rotation.from_rotvec(-mean + np.cross(w[a + 1 : b], w[a : b - 1]) * INTERVAL**2 / 12)
            for turn in turns.as_matrix():
                up = turn @ up
            u = ups[k + 1]
            across = np.linalg.svd(u[None])[2][1:]
            weights = np.linalg.norm(np.linalg.solve(gain.T, np.cross(u, across).T), axis=0)
            left.append(across @ (u - up) / (NOISE.N * np.sqrt(t[b - 1] - t[a]) * weights))
        return np.concatenate(left)

    found = least_squares(missed, np.zeros(12), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    _, mean, sd, _ = solved(run)
    assert np.abs((found.x - mean) / sd).max() < 0.2  # rows are linearised sample by sample
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))), sd, rtol=0.05)


def test_rest_and_up_are_recovered():
    case, _, _, sd = solved(by_hand(2)[0])
    rest, closure = recover(case, [by_hand(2)[0]], sd, case.theta[:12])
    assert (rest.what, closure.what) == ("rest", "closure")
    assert np.abs(closure.before).max() > 20.0 * np.abs(closure.after).max()
    for one in (rest, closure):
        assert one.inside >= 0.8 * one.after.size


def test_six_positions_have_too_few_turns_between_them():
    with pytest.raises(UnobservableError, match="5 turns without a gap between its 6 stills"):
        solved(by_hand(1, positions=6)[0])
