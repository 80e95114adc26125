"""Published results made by hand: what a test does not speak of is that of the committed quickstart."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from imubayes.reporting.result.entries import Scene, Sensor, SensorsResult, Term
from imubayes.reporting.result.file import Written, adapter

FILE = Written(Path("result.json"), "", "study", "1", {})

QUICKSTART = json.loads(
    (Path(__file__).parents[2] / "reports" / "quickstart" / "result.json").read_text(encoding="utf-8")
)

BASE: SensorsResult = adapter().validate_python(QUICKSTART)


def a_term(name: str, mean: float, sd: float, verdict: str = "needed", unit: str = "m/s^2") -> Term:
    """Term with its mean and sd under the full library."""
    told = {"name": name, "unit": unit, "printed_unit": unit, "full_mean": mean, "full_sd": sd}
    return BASE["sensors"][0]["terms"][0] | told | {"verdict": verdict}


def a_sensor(
    id: str, terms: Sequence[Term], noise: Mapping[str, tuple[float, float]], **other: object
) -> Sensor:
    """Component with terms, and N of its runs with the sd of its logarithm."""
    base, unknown = BASE["sensors"][0], {"B": math.nan, "K": math.nan}
    return (
        base
        | {"id": id, "kind": "accelerometer", "class": None, "terms": tuple(terms), "noise_posterior": {}}
        | {"noise": {run: {"N": value, **unknown} for run, (value, _) in noise.items()}}
        | {
            "runs": tuple(
                base["runs"][0] | {"name": run, "noise_log_sd": {"N": sd, **unknown}}
                for run, (_, sd) in noise.items()
            )
        }
        | other
    )


def a_result(*sensors: Sensor, scenes: Sequence[Scene] = (), seed: int = 1) -> SensorsResult:
    """Result of a study of sensors."""
    return BASE | {"sensors": sensors, "scenes": tuple(scenes), "seed": seed}
