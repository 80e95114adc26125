"""Studies drawn at random from the keys of a study file: each is answered, or refused in a sentence."""

import json
import math
import warnings

import numpy as np
import pytest

from imubayes.cli import ExportFormat
from imubayes.ladder import NAMES

CLASSES = {
    "accelerometer": ("mems_consumer", "mems_industrial", "mems_tactical", "quartz_flexure_servo"),
    "gyroscope": ("mems_consumer", "mems_industrial", "mems_tactical", "fog_tactical", "fog_navigation"),
}

ONE = tuple(CLASSES)

RUNS = {
    "positions": ("tumble", 'positions = {few}, dwell = "{dwell} s", rate = "1 Hz"'),
    "tumble": ("tumble", 'angles = {few}, planes = {planes}, dwell = "{dwell} s", rate = "1 Hz"'),
    "centrifuge": ("centrifuge", 'levels = ["1 g", "{level} g"], dwell = "{dwell} s", rate = "1 Hz"'),
    "rate-table": ("rate-table", 'rates = ["-{level} deg/s", "9 deg/s"], dwell = "{dwell} s", rate = "1 Hz"'),
    "static": ("static", 'duration = "{log} s", rate = "1 Hz"'),
    "thermal": ("thermal", 'temperatures = ["-20 degC", "60 degC"], soak = "{dwell} min", rate = "0.2 Hz"'),
    "oscillation": ("oscillation", 'frequencies = ["{planes} Hz"], dwell = "2 s", rate = "50 Hz"'),
    "free-tumble": ("free-tumble", 'attitudes = 18, dwell = "{planes} s", rate = "20 Hz"'),
}  # fmt: skip
"""Procedure and plan of runs by name, of sizes that are drawn."""

PROCEDURES = {
    "accelerometer": ("positions", "tumble", "centrifuge", "static", "thermal", "oscillation", "free-tumble"),
    "gyroscope": ("positions", "tumble", "rate-table", "static", "thermal", "oscillation"),
    "imu": ("tumble", "rate-table", "free-tumble"),
}

ERRORS = {
    "gravity": "",
    "rate_scale": "rate-table",
    "radius": "centrifuge",
    "table_zero": "tumble",
    "plane_zero": "tumble",
    "fixture_common": "",
    "fixture": "",
    "latency": "oscillation",
}
"""Errors of the bench, by the procedure that they need."""

ESTIMATE = '"estimate"'

ASKED = (*(("--method", name) for name in NAMES), ("--budget", "1 s"), ("--accuracy", "0.5"), ())


def a_study(rng, kinds):
    """Text of a study of one of these kinds of sensors, which may ask for what does not go together."""
    kind = rng.choice(kinds)
    runs = rng.choice(PROCEDURES[kind], rng.integers(1, 4)).tolist()
    if "free-tumble" in runs:
        runs = ["free-tumble"] * min(len(runs), 2)
    kinds = ("accelerometer", "gyroscope") if kind == "imu" else (kind,)
    own = {name: rng.choice(CLASSES[name][:3] if len(kinds) > 1 else CLASSES[name]) for name in kinds}
    lines = [
        f"[study]\nseed = {rng.integers(100)}",
        f'[noise]\nidentify = "{rng.choice(("static", "all", "none"))}"',
        f"[decision]\nfalse_drop = {rng.choice((0.1, 1.0, 10.0))}",
        f"hierarchy = {rng.choice(('true', 'false'))}\ncompare = {rng.choice(('true', 'false'))}",
        '[sampling]\ness = 50\ntime_limit = "2 s"',
        f'[[sensor]]\nid = "S"\nkind = "{kind}"\nrobust = {rng.choice(("true", "false", "false"))}',
    ]
    named = ", ".join(f'{name} = "{one}"' for name, one in own.items())
    lines.append(f"class = {{ {named} }}" if len(kinds) > 1 else f'class = "{own[kind]}"')
    errors = [name for name, where in ERRORS.items() if (not where or where in runs) and rng.random() < 0.2]
    if errors and rng.random() < 0.5:
        lines.append('bench = "drawn"')
    for name in kinds:
        table = f"sensor.library.{name}" if len(kinds) > 1 else "sensor.library"
        lines += [
            f"[{table}]\npowers = {rng.integers(1, 6)}\nasymmetry = {rng.integers(-1, 3)}",
            f'set = "{rng.choice(("slide", "extended"))}"\ntemperature = {int("thermal" in runs)}',
        ]
    if errors:
        lines.append("[sensor.reference]")
    for name in errors:
        size = '"1 ms"' if name == "latency" else "true"
        lines.append(f"{name} = {rng.choice((size, size, ESTIMATE))}")
    for k, name in enumerate(runs):
        sizes = {"few": rng.choice((4, 6, 12)), "planes": rng.integers(1, 4), "dwell": rng.choice((2, 5, 10))}
        sizes |= {"level": rng.choice((2, 10, 40)), "log": rng.choice((10, 100, 2000))}
        procedure, plan = RUNS[name]
        lines.append(f'[[sensor.run]]\nname = "r{k}"\nprocedure = "{procedure}"')
        lines.append(f"simulate = {{ {plan.format(**sizes)} }}")
        if rng.random() < 0.15:
            lines.append(str(rng.choice(('noise = "white"', 'noise = { N = "1 ug/sqrt(Hz)" }'))))
    if rng.random() < 0.3:
        lines.append('[[scene]]\nname = "helicopter"\nbudget = { attitude = "1 deg" }')
    return "\n".join(lines) + "\n"


def _ends_well(ended):
    """Nothing but an answer, or a refusal in one sentence."""
    assert ended.code in (0, 2), ended.words
    assert "Warning" not in ended.words and "fault of imubayes" not in ended.words, ended.words
    return ended.code == 0


SLOW, QUICK = pytest.mark.slow, (1, 2, 4)

CASES = [
    *(pytest.param(ONE, k, id=f"one-{k}", marks=() if k in QUICK else SLOW) for k in range(70)),
    *(pytest.param(("imu",), seed, id=f"imu-{seed}", marks=SLOW) for seed in range(12)),
]


@pytest.mark.parametrize(("kinds", "seed"), CASES)
def test_a_study_is_answered_or_refused_in_a_sentence(command, tmp_path, kinds, seed):
    rng = np.random.default_rng(seed)
    path, out = tmp_path / "study.toml", tmp_path / "out"
    path.write_text(a_study(rng, kinds))
    asked = ASKED[rng.integers(len(ASKED))]
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        _ends_well(command("check", path))
        if not _ends_well(command("run", path, "--out", out, *asked)):
            assert not out.exists()
            return
        for to in ExportFormat:
            _ends_well(command("export", out, "--to", to, "--out", tmp_path / to))
        _ends_well(command("compare", out, out, "--out", tmp_path / "compared"))
    for sensor in json.loads((out / "result.json").read_text())["sensors"]:
        for term in sensor["terms"]:
            told = [term[name] for name in ("mean", "sd", "full_mean", "full_sd", "inclusion")]
            assert all(isinstance(one, float) and math.isfinite(one) for one in told), term
            assert 0.0 <= term["inclusion"] <= 1.0 and term["full_sd"] >= 0.0
        for check in sensor["residuals"]:
            far = check["scale"] is not None and not 0.5 < check["scale"] < 2.0
            assert not (far and check["fits"] and check["level"] > 1e-6), check
