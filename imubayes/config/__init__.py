"""Study files: the only place that knows TOML."""

from imubayes.config.reading import read, read_plan, read_runs, read_study
from imubayes.config.recorded import record_study

__all__ = ["read", "read_plan", "read_runs", "read_study", "record_study"]
