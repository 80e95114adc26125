"""Campaigns that the tests of the samplers share."""

from __future__ import annotations

import pytest
from campaigns import Campaign, campaign_of

import imubayes as ib


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    """Noise of both runs estimated: twelve coefficients, six noise parameters."""
    return campaign_of()


@pytest.fixture(scope="session")
def given() -> Campaign:
    """Noise of both runs given."""
    fixed = ib.NoiseRule("fixed", ib.Noise(6e-4, 4e-4, 3e-6))
    return campaign_of({"tumble": fixed, "centrifuge": fixed})
