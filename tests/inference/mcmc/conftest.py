"""Campaigns that the tests of the samplers share."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from campaigns import Campaign, campaign_of  # noqa: E402: the folder has to be known first

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
