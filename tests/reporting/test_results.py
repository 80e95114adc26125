from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from imubayes.reporting.result.file import adapter
from imubayes.reporting.results import result_json


def test_result_is_strict_json_that_reads_back(result) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    assert adapter().validate_python(json.loads(result_json(result), parse_constant=refuse))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, np.float64("nan")])
def test_what_is_not_finite_becomes_null(result, value: float) -> None:
    sensor = result.sensors[0]
    check = replace(sensor.checks[0], whiteness_p=value)
    broken = replace(sensor, checks=(check,), calibration={"scale": value, "bias": np.float64(2.0)})
    (written,) = json.loads(result_json(replace(result, sensors=(broken,))))["sensors"]
    assert written["residuals"][0]["whiteness_p"] is None
    assert written["calibration"] == {"scale": None, "bias": 2.0}


def test_values_are_in_si(result) -> None:
    (sensor,) = json.loads(result_json(result))["sensors"]
    bias = next(term for term in sensor["terms"] if term["name"] == "b0")
    assert bias["unit"] == "m/s^2" and bias["mean"] == pytest.approx(1502.1e-6 * 9.80665, rel=1e-12)


def test_same_result_gives_the_same_bytes(make_study) -> None:
    assert result_json(make_study()) == result_json(make_study())


def test_component_of_a_triad_is_written_with_its_own_terms_only(make_sensor, make_study) -> None:
    sensor = make_sensor("IMU.ay")
    seen, own = sensor.selection.observability, [term.name for term in sensor.selection.terms]
    columns = tuple(f"ay.{name}" for name in own)
    wide = replace(
        seen,
        names=("ax.b0", *columns),
        tested=np.concatenate([[False], seen.tested]),
        ratio=np.concatenate([[0.5], seen.ratio]),
        alone=np.concatenate([[0.5], seen.alone]),
        vif=np.concatenate([[9.0], seen.vif]),
        groups=(),
    )
    selection = replace(sensor.selection, columns=columns, observability=wide)
    (written,) = json.loads(result_json(make_study(replace(sensor, selection=selection))))["sensors"]
    assert list(written["observability"]) == own
    assert written["observability"]["b0"]["ratio"] == seen.ratio[0]
