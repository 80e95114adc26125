"""Study files: the only place that knows TOML."""

from imubayes.study.schema.reading import read, read_plan, read_runs, read_study
from imubayes.study.schema.recorded import record_study

__all__ = ["read", "read_plan", "read_runs", "read_study", "record_study"]
