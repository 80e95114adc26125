"""A wrong unit, sign or axis in a study is named; what a sensor of the class may be is let pass."""

from dataclasses import replace

import hands
import numpy as np
import pytest

from imubayes.errors import DataError
from imubayes.inference.conflicts import refuse_conflicts
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.terms import library
from imubayes.units import STANDARD_GRAVITY as G0

CLASSES = {kind: sensor("mems_consumer", kind=kind) for kind in ("accelerometer", "gyroscope")}
PRIORS = {kind: (entry, {}) for kind, entry in CLASSES.items()}
WIDE = {kind: (None, {}) for kind in CLASSES}
DEGREE = np.pi / 180.0


def a_tumble(y=lambda y: y, inputs=lambda f_i, f_j: {"f_i": f_i, "f_j": f_j}):
    angle = np.repeat(np.deg2rad(np.arange(0.0, 360.0, 30.0)), 20)
    f_i, f_j = 9.81 * np.cos(angle), 9.81 * np.sin(angle)
    output = 1.004 * f_i + 0.02 * f_j + 0.3 + 1e-3 * np.random.default_rng(1).standard_normal(len(angle))
    return Run("tumble", "tumble", Inputs(np.arange(len(angle)) * 1.0, inputs(f_i, f_j), 1.0), y(output))


def a_rate_table(y=lambda y: y):
    w = np.repeat(np.deg2rad(np.arange(-90.0, 91.0, 30.0)), 20)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(len(w))
    return Run("table", "rate-table", Inputs(np.arange(len(w)) * 1.0, {"w_i": w}, 1.0), y(1.01 * w + noise))


KNOWN = {
    "g under m/s^2": (a_tumble(lambda y: y / G0), r'output looks like g under m/s\^2: expected unit = "g"'),
    "m/s^2 under g": (a_tumble(lambda y: y * G0), r'looks like m/s\^2 under g: expected unit = "m/s\^2"'),
    "sign": (a_tumble(lambda y: -y), "opposite sign"),
    "axes": (a_tumble(inputs=lambda f_i, f_j: {"f_i": f_j, "f_j": f_i}), "follows f_j and not f_i"),
    "inputs": (
        a_tumble(inputs=lambda f_i, f_j: {"f_i": f_i / G0, "f_j": f_j / G0}),
        r'inputs f look like g under m/s\^2: expected unit = "g"',
    ),
    "deg/s under rad/s": (a_rate_table(lambda y: y / DEGREE), 'expected unit = "deg/s"'),
    "rad/s under deg/s": (a_rate_table(lambda y: y * DEGREE), 'expected unit = "rad/s"'),
}  # fmt: skip


@pytest.mark.parametrize("priors", [PRIORS, WIDE], ids=["class", "no class"])
@pytest.mark.parametrize("mistake", KNOWN)
def test_mistake_in_a_run_with_known_inputs_is_named(mistake, priors):
    run, said = KNOWN[mistake]
    with pytest.raises(DataError, match=rf"run '{run.name}'.*{said}.*accept_prior_conflict = true"):
        refuse_conflicts(run, "gyroscope" if run.name == "table" else "accelerometer", priors)


def test_output_beyond_the_class_that_nothing_explains_is_refused():
    with pytest.raises(DataError, match=r"output is .* prior sds from"):
        refuse_conflicts(a_tumble(lambda y: y + 80.0), "accelerometer", PRIORS)


NO_ERRORS = [hands.with_truth(library(kind, powers=1, asymmetry=0), {}) for kind in CLASSES]
IN_HAND = hands.in_the_hand(*NO_ERRORS, stills=12)


def in_hand(force=lambda f: f, rate=lambda w: w):
    return replace(IN_HAND, output=np.hstack((force(IN_HAND.force), rate(IN_HAND.rate))))


HELD = {
    "g": (in_hand(force=lambda f: f / G0), 'ax ay az look like g under'),
    "deg/s": (in_hand(rate=lambda w: w / DEGREE), 'expected unit = "deg/s"'),
    "rad/s": (in_hand(rate=lambda w: w * DEGREE), 'expected unit = "rad/s"'),
    "gyroscopes reversed": (in_hand(rate=lambda w: -w), "about x y z are -gx, -gy, -gz"),
    "a gyroscope reversed": (in_hand(rate=lambda w: w * [1, 1, -1]), "about x y z are gx, gy, -gz"),
    "gyroscopes swapped": (in_hand(rate=lambda w: w[:, [1, 0, 2]]), "about x y z are gy, gx, gz"),
    "accelerometers swapped": (in_hand(force=lambda f: f[:, [0, 2, 1]]), "about x y z are -gx, -gz, -gy"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", HELD)
def test_mistake_with_an_imu_in_the_hand_is_named(mistake):
    run, said = HELD[mistake]
    with pytest.raises(DataError, match=said):
        refuse_conflicts(run, "accelerometer", PRIORS)


def test_mistake_in_positions_and_turns_is_named():
    run = hands.on_a_table(NO_ERRORS)
    refuse_conflicts(run, "accelerometer", PRIORS)
    swapped = replace(run, output=run.output[:, [0, 2, 1, 3, 4, 5]])
    with pytest.raises(DataError, match="ay follows f_z and not f_y"):
        refuse_conflicts(swapped, "accelerometer", PRIORS)
    in_degrees = replace(run, output=run.output / [1.0, 1.0, 1.0, DEGREE, DEGREE, DEGREE])
    with pytest.raises(DataError, match="gx looks like deg/s under rad/s"):
        refuse_conflicts(in_degrees, "accelerometer", PRIORS)


def test_what_a_sensor_of_the_class_may_be_is_let_pass():
    terms = library("accelerometer", powers=1, asymmetry=0).terms[:4]
    sd = np.array([prior_sd(CLASSES["accelerometer"], term)[0] for term in terms])
    f = a_tumble().inputs.channels
    for seed in range(20):
        b0, b1, m_j, _ = 10.0 * sd * np.random.default_rng(seed).standard_normal(4)
        run = a_tumble(lambda y, more=b0 + b1 * f["f_i"] + m_j * f["f_j"]: y + more)
        refuse_conflicts(run, "accelerometer", PRIORS)
    for priors in (PRIORS, WIDE):
        refuse_conflicts(a_tumble(), "accelerometer", priors)
        refuse_conflicts(a_rate_table(), "gyroscope", priors)
    refuse_conflicts(IN_HAND, "accelerometer", PRIORS)
