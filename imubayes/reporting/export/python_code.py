"""The compensation as a Python module that needs numpy alone."""

from __future__ import annotations

from typing import Any

from imubayes.reporting.export.characterized import Characterized
from imubayes.reporting.export.equations import Language
from imubayes.reporting.export.heading import identifier
from imubayes.reporting.export.templating import model_values, rendered

PYTHON = Language(lambda value: repr(float(value)), lambda column: f"u[{column}]", lambda x: f"np.sign({x})")


def python_files(found: Characterized) -> dict[str, str]:
    """Text of the module by its file name.

    Raises
    ------
    InputError : if the model cannot be inverted over the range that was tested.
    """
    return {f"{identifier(found)}_compensation.py": python_text(found)}


def python_text(found: Characterized) -> str:
    """Text of the module; a docstring cannot be ended by what the result says."""
    values = model_values(found, PYTHON)
    values["heading"] = [line.replace("\\", "/").replace('"""', "'''") for line in values["heading"]]
    return rendered("compensation.py.j2", values)


def compiled(found: Characterized) -> dict[str, Any]:
    """Names that the exported module defines: ``compensate``, ``forward``."""
    names: dict[str, Any] = {}
    exec(compile(python_text(found), f"<{identifier(found)}>", "exec"), names)
    return names
