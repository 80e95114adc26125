"""The committed sample reports are what the shipped studies give today."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
REPORTS = {path.parent.name: path for path in sorted((ROOT / "reports").glob("*/result.json"))}

COMMANDS = {
    "plan_mems_vs_fog": ("plan", "studies/mems_vs_fog.toml"),
    "plan_tactical": ("plan", "studies/plan_tactical.toml"),
    "trade_quickstart": ("trade", "studies/quickstart.toml", "--limit", "7 min"),
    "trade_mems_vs_fog": (
        *("trade", "studies/mems_vs_fog.toml", "--only", "mems_tactical"),
        *("--rungs", "means,sparse,plug-in,collapsed,raw", "--repeats", "2", "--limit", "8 min"),
    ),
}
"""How a report is made where it isn't by `imubayes run` on the study of its name."""

OF_THE_TOOL = {path.parent.name for path in (ROOT / "studies").glob("*/__main__.py")}
"""Reports that are made by ``python -m studies.NAME``."""

TIMES = {"speed", "trade_quickstart", "trade_mems_vs_fog", "sampler_speed"}
"""Reports of times: what they compare is held, their figures are another machine's."""

OF_THE_MACHINE = {"seconds", "imubayes", "versions"}
"""Keys that differ from run to run."""

SAME = 1e-3
"""Relative; beyond the digits that are printed, and above where two machines stop in finding the noise."""

MONTE_CARLO = 0.2
"""Posterior sds; of a mean over chains, whose path another build of the linear algebra changes."""

CORRECT_DIGITS = 1.0
"""Of the digits that turn out correct at the extremes: where they end is rounding, of one build."""


SDS = ("sd", "full_sd")
"""Of a term: averaged over models, and under the full library, as its chains are."""


def _differences(old: Any, new: Any, where: str = "", sd: float = 0.0) -> Iterator[str]:
    """Say where two results differ: keys, words, truth values, and numbers beyond what may differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        if old.keys() != new.keys():
            yield f"{where}: keys {sorted(old.keys() ^ new.keys())}"
        spread = max([old[name] for name in SDS if isinstance(old.get(name), float)], default=sd)
        for key in sorted((old.keys() & new.keys()) - OF_THE_MACHINE):
            yield from _differences(old[key], new[key], f"{where}.{key}", spread)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{where}: {len(old)} entries, now {len(new)}"
        for k, (one, other) in enumerate(zip(old, new, strict=False)):
            yield from _differences(one, other, f"{where}[{k}]", sd)
    elif isinstance(old, float) and isinstance(new, int | float):
        within = CORRECT_DIGITS if where.endswith(".correct") else max(MONTE_CARLO * sd, 1e-12)
        if not math.isclose(old, new, rel_tol=SAME, abs_tol=within):
            yield f"{where}: {old:.8g}, now {new:.8g}"
    elif old != new:
        yield f"{where}: {old!r}, now {new!r}"


def _keys(found: Any) -> Any:
    """Keys of a result whose numbers are times."""
    return {key: _keys(value) for key, value in found.items()} if isinstance(found, dict) else None


def test_a_changed_number_word_or_key_is_a_difference():
    old = {"a": {"mean": 1.0, "sd": 0.1}, "b": [1.0, 2.0], "c": "needed", "seconds": 3.0, "correct": 14.2}
    assert not list(_differences(old, {**old, "seconds": 9.0}))
    assert not list(_differences(old, {**old, "a": {"mean": 1.01, "sd": 0.1}, "correct": 13.5}))
    for other in (
        {**old, "a": {"mean": 1.05, "sd": 0.1}},
        {**old, "b": [1.0]},
        {**old, "b": [1.0, 2.01]},
        {**old, "c": "not needed"},
        {**old, "correct": 12.9},
        {"a": old["a"], "b": old["b"]},
    ):
        assert list(_differences(old, other))


def test_every_shipped_study_has_its_report():
    studies = {path.stem for path in (ROOT / "studies").glob("*.toml")}
    assert studies <= REPORTS.keys()
    assert REPORTS.keys() - studies <= COMMANDS.keys() | OF_THE_TOOL


def test_every_committed_page_leads_to_the_list_of_all():
    pages = [page for path in REPORTS.values() for page in path.parent.glob("*.html")]
    assert len(pages) > len(REPORTS)
    for page in pages:
        assert '<a href="../index.html">' in page.read_text("utf-8"), f"{page}: made with --out elsewhere"


@pytest.mark.slow
@pytest.mark.parametrize("name", REPORTS)
def test_the_committed_report_is_what_its_study_gives_today(name: str, recordings: Path, tmp_path: Path):
    command = COMMANDS.get(name, ("run", f"studies/{name}.toml"))
    called = ("-c", "from imubayes.cli import main; main()", *command)
    if name in OF_THE_TOOL:
        called = ("-m", f"studies.{name}")
    done = subprocess.run(
        [sys.executable, *called, "--out", str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    old = json.loads(REPORTS[name].read_text(encoding="utf-8"))
    new = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    if name in TIMES:
        old, new = _keys(old), _keys(new)
    assert not list(_differences(old, new)), f"make it again: {' '.join(called)}"
