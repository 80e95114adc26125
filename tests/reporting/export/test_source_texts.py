"""The exported Python module and MATLAB function, run against the model."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exported_results import ENDS, IDENTICAL, MODELS, rows_inside, write_imu

from imubayes.reporting.export.characterized import Characterized, characterized
from imubayes.reporting.export.source_texts import compiled, matlab_files, python_files
from imubayes.sensors.imu import forward, signals
from imubayes.sensors.imu_compensation import split_jumps

SCALE = np.repeat([ENDS["f"], ENDS["w"]], 3)


def outputs_of(found: Characterized, n: int = 300):
    inputs = signals(**rows_inside(2, n))
    return inputs, forward(found.imu, inputs)


@pytest.mark.parametrize("model", MODELS)
def test_the_python_module_returns_the_inputs(tmp_path, model):
    found = characterized(write_imu(tmp_path), model=model)
    module = compiled(found)
    inputs, outputs = outputs_of(found)
    f, w = module["compensate"](outputs.f, outputs.w, inputs.dw, inputs.T, inputs.warming)
    error = np.abs(np.hstack([f - inputs.f, w - inputs.w])) / SCALE
    _, jumps = split_jumps(found.imu)
    sizes = np.array([max(0.0, -c.theta.sum()) for c in jumps.components])
    kept = (np.abs(np.hstack([inputs.f, inputs.w])) > 3.0 * sizes).all(axis=1)
    assert error[kept].max() < IDENTICAL and kept.sum() > 200
    again = np.hstack(module["forward"](inputs.f, inputs.w, inputs.dw, inputs.T, inputs.warming))
    assert (np.abs(again - np.hstack([outputs.f, outputs.w])) / SCALE).max() < IDENTICAL


def test_the_python_module_needs_numpy_alone_and_refuses_what_was_not_tested(tmp_path):
    ((name, text),) = python_files(characterized(write_imu(tmp_path, title='"""\\ quoted'))).items()
    imported = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [alias.name for node in imported for alias in node.names] == ["numpy"]
    (tmp_path / name).write_text(text)
    program = f"import {name[:-3]} as m; m.compensate([[0, 0, {1.5 * ENDS['f']}]], [[0, 0, 0]])"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert "ValueError: row 0: |f_z| is over 60" in done.stderr


def matlab_sums(text: str, function: str) -> list[list[str]]:
    """Products of each component in a function of the MATLAB text, as Python expressions."""
    body = re.search(rf"function d = {function}\(u\)\n(.*?)\nend\n", text, re.DOTALL).group(1)
    sums: list[list[str]] = [[] for _ in range(6)]
    for row, product in re.findall(r"^d\((\d), :\) = d\(\1, :\) \+ (.*?); %", body, re.MULTILINE):
        plain = re.sub(r"u\((\d+), :\)", lambda m: f"u[{int(m.group(1)) - 1}]", product)
        sums[int(row) - 1].append(plain.replace(".*", "*").replace("sign(", "np.sign("))
    return sums


def evaluated(sums: list[list[str]], u: np.ndarray) -> np.ndarray:
    zero, names = np.zeros(u.shape[1]), {"u": u, "np": np}
    return np.array([sum((eval(product, names) for product in row), zero) for row in sums])


@pytest.mark.parametrize("model", MODELS)
def test_the_terms_in_the_matlab_text_add_up_to_the_model(tmp_path, model):
    found = characterized(write_imu(tmp_path), model=model)
    (text,) = matlab_files(found).values()
    inputs, outputs = outputs_of(found)
    u = np.vstack([inputs.f.T, inputs.w.T, inputs.dw.T, inputs.T - 298.15, inputs.warming])
    d, jumps = (evaluated(matlab_sums(text, function), u) for function in ("deviations", "jumps"))
    found_outputs = (u[:6] + d + jumps * np.sign(u[:6])).T
    assert (np.abs(found_outputs - np.hstack([outputs.f, outputs.w])) / SCALE).max() < IDENTICAL


@pytest.mark.skipif(shutil.which("octave") is None, reason="needs octave")
@pytest.mark.parametrize("model", MODELS)
def test_octave_returns_the_inputs(tmp_path, model):
    found = characterized(write_imu(tmp_path), model=model)
    ((name, text),) = matlab_files(found).items()
    (tmp_path / name).write_text(text)
    inputs, outputs = outputs_of(found, 50)
    np.savetxt(tmp_path / "out.txt", np.hstack([outputs.f, outputs.w]).T, fmt="%.17g")
    np.savetxt(tmp_path / "known.txt", np.column_stack([inputs.dw, inputs.T, inputs.warming]).T, fmt="%.17g")
    program = (
        f"imu = {Path(name).stem}(); x = imu.compensate(load('out.txt'), load('known.txt'));"
        " y = imu.forward(x, load('known.txt')); printf('%.17g\\n', max(max(abs(y - load('out.txt')))))"
    )
    command = ["octave", "--no-gui", "--eval", program]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=True)
    assert float(done.stdout.split()[-1]) < IDENTICAL * ENDS["f"]
