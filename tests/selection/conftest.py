"""A decision that several modules look at."""

import pytest
from decisions import Campaign, campaign_of

import imubayes as ib


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    """Bias, scale, one even term and one misalignment, on a tumble and a centrifuge."""
    plans = [ib.tumble(angles=12, planes=3), ib.centrifuge([1, 5, 20])]
    truth = {"b0": 0.02, "b1": 4e-4, "b2": 5e-6, "m_j": 1e-3}
    return campaign_of("mems_tactical", plans, seed=8, truth=truth, powers=2, asymmetry=0)
