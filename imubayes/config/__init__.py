"""Study files: the only place that knows TOML."""

from imubayes.config.reading import (
    read_extremes,
    read_fleet,
    read_lots,
    read_quality,
    read_runs,
    read_speed,
    read_study,
)
from imubayes.config.recorded import record_study

__all__ = [
    "read_extremes",
    "read_fleet",
    "read_lots",
    "read_quality",
    "read_runs",
    "read_speed",
    "read_study",
    "record_study",
]
