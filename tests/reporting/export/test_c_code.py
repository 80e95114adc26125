"""The exported C: compiled with every warning an error, and run against Python."""

import ctypes
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from compiling import built, call
from exported_results import ENDS, IDENTICAL, MODELS, rows_inside, write_imu

from imubayes.reporting.export.characterized import Characterized, characterized
from imubayes.reporting.export.source_texts import single_precision_error
from imubayes.sensors.imu import forward, signals
from imubayes.sensors.imu_compensation import compensate

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory) -> Callable[[str], tuple[Characterized, ctypes.CDLL, Path]]:
    """A model of the IMU, its library and the folder of its files; compiled once."""

    @cache
    def of(model: str) -> tuple[Characterized, ctypes.CDLL, Path]:
        folder = tmp_path_factory.mktemp(model)
        found = characterized(write_imu(folder), model=model)
        return found, built(found, folder), folder

    return of


def cases(found: Characterized, n: int = 500):
    inputs = signals(**rows_inside(1, n))
    known = np.column_stack([inputs.dw, inputs.T, inputs.warming])
    return inputs, forward(found.imu, inputs), known


@pytest.mark.parametrize("model", MODELS)
def test_double_precision_is_python_to_1e_12(compiled, model):
    found, library, _ = compiled(model)
    inputs, outputs, known = cases(found)
    rows = np.hstack([outputs.f, outputs.w])
    by_c, codes = call(library.u_1_compensate, rows, known, np.float64)
    by_python = compensate(found.imu, outputs, found.within)
    scale = np.repeat([ENDS["f"], ENDS["w"]], 3)
    assert not codes.any()
    assert (np.abs(by_c - np.hstack([by_python.f, by_python.w])) / scale).max() < IDENTICAL
    back, _ = call(library.u_1_forward, np.hstack([inputs.f, inputs.w]), known, np.float64)
    assert (np.abs(back - rows) / scale).max() < IDENTICAL


@pytest.mark.parametrize("model", MODELS)
def test_single_precision_is_within_the_error_that_its_header_states(compiled, model):
    found, library, folder = compiled(model)
    _, outputs, known = cases(found, 2000)
    rows = np.hstack([outputs.f, outputs.w])
    single, _ = call(library.u_1_compensate_f32, rows, known, np.float32)
    double, _ = call(library.u_1_compensate, rows, known, np.float64)
    stated = single_precision_error(found)
    header = (folder / "u_1_compensation_f32.h").read_text()
    assert f"is {stated[0]:.2g} m/s^2 in f and {stated[1]:.2g} rad/s in w" in header
    for columns, limit, end in ((slice(0, 3), stated[0], ENDS["f"]), (slice(3, 6), stated[1], ENDS["w"])):
        error = np.abs(single - double)[:, columns].max()
        # the maximum over other random rows than the statement's: one ulp of the range more at most
        assert error <= limit + np.finfo(np.float32).eps * end
        assert limit < 30.0 * np.finfo(np.float32).eps * end


@pytest.mark.parametrize(("column", "code"), [(0, 1), (4, 5), (6, 7), (9, 10), (10, 11)])
def test_the_first_input_outside_is_returned_by_number(compiled, column, code):
    found, library, _ = compiled("needed")
    u = np.zeros((1, 11))
    u[0, 9] = 298.15
    u[0, column] += 1.5 * found.within.ends[column]
    known = u[:, 6:]
    rows, _ = call(library.u_1_forward, u[:, :6], known, np.float64)
    _, codes = call(library.u_1_compensate, rows, known, np.float64)
    assert codes.tolist() == [code]
    # nor are outputs taken that are no numbers
    _, codes = call(library.u_1_compensate, np.full((1, 6), np.nan), np.zeros((1, 5)), np.float64)
    assert codes[0] != 0


def test_a_title_cannot_end_the_comment(tmp_path):
    found = characterized(write_imu(tmp_path, title='x */ int y; /* "\n#error'))
    assert built(found, tmp_path) is not None
