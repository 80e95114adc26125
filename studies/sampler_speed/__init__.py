"""Samplers of others on every row of a campaign: what ``studies/sampler_speed.toml`` is held against."""
