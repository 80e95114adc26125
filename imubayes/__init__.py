"""Which terms of the generalized IMU model a sensor needs, and how sure that is.

The stages are functions, the values between them frozen dataclasses::

    sensor  = ib.sensor("mems_tactical", kind="accelerometer")
    library = ib.library("accelerometer", powers=3, asymmetry=2, set="slide")
    runs    = ib.simulate(sensor, [ib.tumble(angles=24), ib.centrifuge([1, 5, 20])], seed=1)
    summary = ib.summarize(runs, library, sensor=sensor)
    chosen  = ib.select(summary, ib.prior(sensor, library))
    print(chosen.table())

Glossary: *run*, one recording of one procedure; *dwell*, a part of it at constant input; *library*, the
candidate terms; *factor*, the triangular matrix that holds all a linear Gaussian model can learn from
whitened rows; N, B, K, white noise, bias instability and random walk; *inclusion*, the posterior
probability that a term is in the model.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from imubayes.inference.linear import linear_of as linear_of
    from imubayes.inference.mcmc.ensembles import Limits as Limits
    from imubayes.inference.mcmc.run import sample as sample
    from imubayes.inference.prior import GPrior as GPrior
    from imubayes.inference.prior import HyperG as HyperG
    from imubayes.inference.prior import ScalePrior as ScalePrior
    from imubayes.inference.prior import ZellnerSiow as ZellnerSiow
    from imubayes.inference.prior import prior as prior
    from imubayes.inference.summary import Summary as Summary
    from imubayes.inference.summary import summarize as summarize
    from imubayes.rig.profiles import centrifuge as centrifuge
    from imubayes.rig.profiles import oscillation as oscillation
    from imubayes.rig.profiles import positions as positions
    from imubayes.rig.profiles import rate_table as rate_table
    from imubayes.rig.profiles import static as static
    from imubayes.rig.profiles import tumble as tumble
    from imubayes.rig.profiles import vibration as vibration
    from imubayes.rig.simulate import simulate as simulate
    from imubayes.rig.thermal import thermal as thermal
    from imubayes.selection.decision import select as select
    from imubayes.selection.enumerate import enumerate_models as enumerate_models
    from imubayes.selection.feature_library import feature_library as feature_library
    from imubayes.sensors.catalogue import sensor as sensor
    from imubayes.sensors.noise import Noise as Noise
    from imubayes.sensors.noise import NoiseRule as NoiseRule
    from imubayes.sensors.terms import library as library
    from imubayes.study.method import check as check
    from imubayes.study.method import run as run
    from imubayes.study.schema import read_runs as read_runs
    from imubayes.study.schema import read_study as read_study

_HOME = {
    "read_runs": "study.schema",
    "read_study": "study.schema",
    "run": "study.method",
    "check": "study.method",
    "linear_of": "inference.linear",
    "Limits": "inference.mcmc.ensembles",
    "sample": "inference.mcmc.run",
    "GPrior": "inference.prior",
    "HyperG": "inference.prior",
    "ScalePrior": "inference.prior",
    "ZellnerSiow": "inference.prior",
    "prior": "inference.prior",
    "Summary": "inference.summary",
    "summarize": "inference.summary",
    "centrifuge": "rig.profiles",
    "oscillation": "rig.profiles",
    "positions": "rig.profiles",
    "rate_table": "rig.profiles",
    "static": "rig.profiles",
    "tumble": "rig.profiles",
    "vibration": "rig.profiles",
    "simulate": "rig.simulate",
    "thermal": "rig.thermal",
    "select": "selection.decision",
    "enumerate_models": "selection.enumerate",
    "feature_library": "selection.feature_library",
    "sensor": "sensors.catalogue",
    "Noise": "sensors.noise",
    "NoiseRule": "sensors.noise",
    "library": "sensors.terms",
}
"""Module of each public name, imported when the name is first used: the command line starts fast."""


def __dir__() -> list[str]:
    return ["__version__", *_HOME]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'imubayes' has no attribute '{name}'")
    return getattr(import_module(f"imubayes.{_HOME[name]}"), name)
