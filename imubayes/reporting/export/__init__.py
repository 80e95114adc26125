"""From a result to something to fly: compensation, simulator models, filter parameters."""

from imubayes.reporting.export.formats import FORMATS, exported

__all__ = ["FORMATS", "exported"]
