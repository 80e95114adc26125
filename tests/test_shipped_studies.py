"""The committed sample reports are what the shipped studies give today."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
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

DIGITS = 1.0
"""Of the digits that are right: where they end is rounding, of one build."""

DRAWN = {
    **{"predictive_p": 0.01, "pareto_k": 0.2, "lead": 1e-3, "common_share": 5e-3, "calibration": 1e-6},
    **{"correct": DIGITS, "digits": DIGITS, "share_of_budget": 1e-5, "share_range": 1e-5},
}
"""How far what is under a key may differ: shares of 4000 draws, a tail of few dwells, log odds, a median,
coefficients that have no sd beside them (SI), digits, a hundredth of the least share that is printed."""

INTERVAL = 0.01
"""Of an interval's width: where a population's mean is next to nothing, its digits are rounding."""

MISFIT = 0.05
"""Relative; of what residuals show of an input, which moves with where within its sd a fit has settled."""

SDS = ("sd", "full_sd", "rms")
"""Beside a number: averaged over models, under the full library as its chains are, or of errors."""

NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?")
"""In a text; the digit of a term's name is none."""


def _largest(found: Any) -> float:
    """Largest sd of one entry: of a term, of what was recovered, of a compensation."""
    there = [found[name] for name in SDS if isinstance(found.get(name), float | list)]
    sds = [np.max(np.abs(sd), initial=0.0) for sd in there]
    if isinstance(found.get("covariance"), list):
        sds.append(np.sqrt(np.max(np.diag(found["covariance"]))))
    return max(sds, default=0.0)


def _width(found: Any) -> float:
    """From the low to the high end of an interval; 0 of another entry."""
    ends = found.get("low"), found.get("high")
    return ends[1] - ends[0] if all(isinstance(end, float) for end in ends) else 0.0


def _per_unit(term: dict[str, Any]) -> float:
    """Effect of a unit of the coefficient of a term."""
    return abs(term["effect"] / term["mean"]) if term.get("effect") and term.get("mean") else 0.0


def _alike(old: str, new: str) -> bool:
    """Whether two texts differ only in numbers, and these by no more than numbers may, or a last digit."""
    if NUMBER.sub("", old) != NUMBER.sub("", new):
        return False
    pairs = zip(NUMBER.findall(old), NUMBER.findall(new), strict=True)
    return all(
        math.isclose(float(a), float(b), rel_tol=SAME, abs_tol=1.001 * 10.0 ** -len(a.partition(".")[2]))
        for a, b in pairs
    )


def _differences(old: Any, new: Any, where: str = "", within: float = 0.0) -> Iterator[str]:
    """Say where two results differ: keys, words, truth values, and numbers beyond what may differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        if old.keys() != new.keys():
            yield f"{where}: keys {sorted(old.keys() ^ new.keys())}"
        spread = MONTE_CARLO * _largest(old) or INTERVAL * _width(old) or within
        for key in sorted((old.keys() & new.keys()) - OF_THE_MACHINE):
            of_key = {"covariance": spread**2, "effect": spread * _per_unit(old), **DRAWN}
            if "input" in old and key in ("share", "size"):
                of_key[key] = MISFIT * abs(old[key])
            yield from _differences(old[key], new[key], f"{where}.{key}", of_key.get(key, spread))
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{where}: {len(old)} entries, now {len(new)}"
        for k, (one, other) in enumerate(zip(old, new, strict=False)):
            yield from _differences(one, other, f"{where}[{k}]", within)
    elif isinstance(old, int | float) and isinstance(new, int | float) and not isinstance(old, bool):
        # of a count, which may be of thousands of draws, a share may differ
        most = within if isinstance(old, float) or within == DIGITS else 0.0
        if not math.isclose(old, new, rel_tol=SAME, abs_tol=max(most, 1e-12)):
            yield f"{where}: {old:.8g}, now {new:.8g}"
    elif isinstance(old, str) and isinstance(new, str):
        if not _alike(old, new):
            yield f"{where}: {old!r}, now {new!r}"
    elif old != new:
        yield f"{where}: {old!r}, now {new!r}"


def _keys(found: Any) -> Any:
    """Keys of a result whose numbers are times."""
    return {key: _keys(value) for key, value in found.items()} if isinstance(found, dict) else None


def test_a_changed_number_word_or_key_is_a_difference():
    old = {"a": {"mean": 1.0, "sd": 0.1}, "b": [1.0, 2.0], "c": "needed", "seconds": 3.0, "correct": 14.2}
    old |= {"d": "k is 0.81 at 3 of 120", "f": "b1 is needed", "g": 1000, "h": 2, "digits": 9}
    old |= {"e": {"mean": [3.0, 0.0], "covariance": [[0.04, 0.0], [0.0, 0.01]]}}
    old |= {"i": {"value": 0.0001, "low": -1.0, "high": 2.0}}
    covariance = [[0.0401, 0.001], [0.001, 0.01]]
    assert not list(_differences(old, {**old, "seconds": 9.0}))
    assert not list(_differences(old, {**old, "a": {"mean": 1.01, "sd": 0.1}, "correct": 13.5}))
    assert not list(_differences(old, {**old, "d": "k is 0.80 at 4 of 120"}))
    assert not list(_differences(old, {**old, "g": 1001, "digits": 8}))
    assert not list(_differences(old, {**old, "e": {"mean": [3.0, 0.03], "covariance": covariance}}))
    assert not list(_differences(old, {**old, "i": {"value": 0.02, "low": -1.01, "high": 2.0}}))
    for other in (
        {**old, "i": {"value": 0.04, "low": -1.0, "high": 2.0}},
        {**old, "a": {"mean": 1.05, "sd": 0.1}},
        {**old, "b": [1.0]},
        {**old, "b": [1.0, 2.01]},
        {**old, "c": "not needed"},
        {**old, "correct": 12.9},
        {**old, "d": "k is 0.83 at 3 of 120"},
        {**old, "f": "b2 is needed"},
        {**old, "g": 990},
        {**old, "h": 3},
        {**old, "d": "k is 0.81 at 3 of 120 dwells"},
        {**old, "e": {"mean": [3.0, 0.05], "covariance": old["e"]["covariance"]}},
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
