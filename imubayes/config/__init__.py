"""Study files: the only place that knows TOML."""

from imubayes.config.reading import read_lots, read_quality, read_runs, read_study
from imubayes.config.recorded import record_study

__all__ = ["read_lots", "read_quality", "read_runs", "read_study", "record_study"]
