"""Results for people and for scripts: tables, figures, the report, result.json, posterior.nc."""
