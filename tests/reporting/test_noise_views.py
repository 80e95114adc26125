"""Noise processes as they are printed and stored."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from block_readings import panels, rows

from imubayes.inference.allan import AllanFit, allan_curve
from imubayes.reporting.noise_views import noise_blocks, published_processes
from imubayes.reporting.rounding import NOISE
from imubayes.selection.noise_choice import NoiseChoice, ProcessSize
from imubayes.units import factor

ARW = factor("deg/sqrt(h)", like="rad/s/sqrt(Hz)")
DPH = factor("deg/h", like="rad/s")


def size(name, mean, verdict, inclusion, partners=()):
    return ProcessSize(
        name, inclusion, mean, 0.1 * abs(mean), 0.8 * mean, mean, 1.2 * mean, 1.2 * abs(mean),
        math.nan if name in ("N", "tau") else 2.0 * abs(mean), verdict, "because", partners,
    )  # fmt: skip


@pytest.fixture
def gyro():
    noise = {"N": 0.15 * ARW, "B": 2.0 * DPH}
    choice = NoiseChoice(
        run="quiet",
        sizes=(
            size("N", noise["N"], "needed", 1.0),
            size("B", noise["B"], "needed", 0.999),
            size("K", 1e-8, "inseparable", 0.6, ("R",)),
            size("Q", 1e-6, "not needed", 0.01),
            size("R", 1e-10, "inseparable", 0.4, ("K",)),
        ),
        sets=((("B",), 0.7), (("B", "K"), 0.3)),
        noise=noise,
        prior="class x",
        samples=1000,
        rows=1000,
        draws=np.zeros((1, 7)),
    )
    y = noise["N"] * np.random.default_rng(1).normal(size=1000)
    curve = allan_curve(y, np.arange(1000.0), 1.0, noise)
    fit = AllanFit(("N", "B"), (0.151 * ARW, 1.9 * DPH), (0.01, 0.1), 10.0, 9)
    return SimpleNamespace(
        kind="gyroscope", runs=(), chains=None, processes=(replace(choice, curve=curve, fit=fit),)
    )


def test_rows_hold_both_routes_and_limits_of_what_is_not_there(gyro):
    blocks = list(noise_blocks(gyro, "s1", drawn=True))
    found = {row[0]: row[3:7] for row in rows(blocks)}
    size, unit, allan, _ = found["B"]
    assert (size, unit, allan) == ("2.00 ± 0.20", "°/h", "1.90 ± 0.19")
    assert found["Q"][0].startswith("below ") and "±" not in found["Q"][0] and found["Q"][2] == ""
    assert found["N"][3] == "" and found["K"][3] != ""
    (panel,) = panels(blocks)
    assert "deg" not in panel.svg and "°/h" in panel.svg


def test_published_processes_are_in_si_and_name_both_units(gyro):
    record = published_processes(gyro)["quiet"]
    assert record["identified"] == ("N", "B")
    assert record["processes"]["B"]["mean"] == pytest.approx(2.0 * DPH)
    assert record["processes"]["B"]["printed_unit"] == "deg/h"
    assert record["allan"]["values"]["N"] == pytest.approx(0.151 * ARW)


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_every_printed_unit_measures_what_its_si_unit_does(kind):
    for printed, si in NOISE[kind].values():
        assert factor(printed, like="" if si == "rad" else si) > 0.0
