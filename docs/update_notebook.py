"""Run ``docs/notebook.ipynb`` from its first cell, and write it with what its cells show.

Run it by ``python docs/update_notebook.py`` where imubayes and pandas are installed; it takes a few seconds,
and needs no Jupyter.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

NOTEBOOK = Path(__file__).parent / "notebook.ipynb"


def main() -> None:
    """Fill the notebook's outputs."""
    NOTEBOOK.write_text(text_of(executed(json.loads(NOTEBOOK.read_text(encoding="utf-8")))), encoding="utf-8")


def text_of(notebook: dict[str, Any]) -> str:
    """Text of the file."""
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """Run the cells of code in their order, in the notebook's folder."""
    names: dict[str, Any] = {}
    before = Path.cwd()
    os.chdir(NOTEBOOK.parent)
    try:
        codes = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        for count, cell in enumerate(codes, 1):
            cell["execution_count"] = count
            cell["outputs"] = [_output(value, count) for value in _values("".join(cell["source"]), names)]
    finally:
        os.chdir(before)
    return notebook


def _values(code: str, names: dict[str, Any]) -> list[Any]:
    """Value of the last line of a cell, where it is an expression that has one."""
    tree = ast.parse(code)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)  # the project's own notebook
    if not isinstance(last, ast.Expr):
        return []
    value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # as above
    return [] if value is None else [value]


def _output(value: Any, count: int) -> dict[str, Any]:
    return {
        "output_type": "execute_result", "execution_count": count, "metadata": {}, "data": _shown(value),
    }  # fmt: skip


def _shown(value: Any) -> dict[str, Any]:
    """What a notebook shows of a value, by its type."""
    if isinstance(value, Figure):
        picture = io.BytesIO()
        value.savefig(picture, format="png", dpi=110, bbox_inches="tight", metadata={"Software": None})
        return {"image/png": base64.b64encode(picture.getvalue()).decode(), "text/plain": ["<Figure>"]}
    if hasattr(value, "_repr_html_"):
        return {
            "text/html": value._repr_html_().splitlines(True),
            "text/plain": [f"<{type(value).__name__}>"],
        }
    return {"text/plain": repr(value).splitlines(True)}


if __name__ == "__main__":
    main()
