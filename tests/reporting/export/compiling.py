"""Exported C, compiled with every warning an error and called row by row."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np

from imubayes.reporting.export.characterized import Characterized
from imubayes.reporting.export.source_texts import c_files

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC")


def built(found: Characterized, folder: Path) -> ctypes.CDLL:
    """Library of both precisions; its sources stay in the folder."""
    texts = c_files(found)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    sources = [str(folder / name) for name in texts if name.endswith(".c")]
    subprocess.run(["gcc", *FLAGS, *sources, "-o", str(folder / "imu.so")], check=True, timeout=100)
    return ctypes.CDLL(str(folder / "imu.so"))


def call(function, rows: np.ndarray, known: np.ndarray, dtype) -> tuple[np.ndarray, np.ndarray]:
    """Results (n, 6) and return values of a function of C, row by row."""
    pointer = np.ctypeslib.ndpointer(dtype=dtype, flags="C_CONTIGUOUS")
    function.argtypes, rows, known = [pointer] * 3, rows.astype(dtype), known.astype(dtype)
    results = np.zeros((len(rows), 6), dtype)
    codes = [function(row, extra, result) for row, extra, result in zip(rows, known, results, strict=True)]
    return results, np.array(codes)
