"""Which terms of the generalized IMU model a sensor needs, and how sure that is.

The stages are functions, the values between them frozen dataclasses::

    sensor  = ib.sensor("mems_tactical", kind="accelerometer")
    library = ib.library("accelerometer", powers=3, asymmetry=2, set="slide")
    runs    = ib.simulate(sensor, [ib.tumble(angles=24), ib.centrifuge([1, 5, 20])], seed=1)
    summary = ib.summarize(runs, library, sensor=sensor)
    chosen  = ib.select(summary, ib.prior(sensor, library))
    print(chosen.table())

Vocabulary, in the order of the way from a test to its report:

=========  ============================================================================================
run        one recording, or simulation, of one procedure: outputs, and inputs where they are known
dwell      a part of a run at constant input
term       one product of inputs and its coefficient, such as ``K2`` times the force squared
library    the candidate terms of a component
class      a technology and grade of the catalogue; a *lot* is units drawn from it, a *fleet* recorded ones
N, B, K    white noise, bias instability and random walk: noise is a process, not a number
rows       averages of a run and the terms' columns, whitened by the noise
factor     the triangular matrix of the rows: all that a linear Gaussian model can learn from them
prior      what is held of each coefficient, and of the number of terms, before the test
model      a subset of the library; its evidence is how probable it makes the rows
inclusion  the posterior probability that a term is in the model
verdict    needed, not needed, undecided, or what this test cannot tell: inseparable, unresolved, untested
scene      a mission's motion and its budget, by which terms are weighed that the verdict keeps
result     what a study publishes, in SI: `result.json`
report     the page and the lines in a terminal that say it
=========  ============================================================================================
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
    from imubayes.rig.rotations import centrifuge as centrifuge
    from imubayes.rig.rotations import oscillation as oscillation
    from imubayes.rig.rotations import rate_table as rate_table
    from imubayes.rig.rotations import vibration as vibration
    from imubayes.rig.simulate import simulate as simulate
    from imubayes.rig.tumbles import positions as positions
    from imubayes.rig.tumbles import static as static
    from imubayes.rig.tumbles import thermal as thermal
    from imubayes.rig.tumbles import tumble as tumble
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

_NAMES = {
    "study.schema": ("read_runs", "read_study"),
    "study.method": ("check", "run"),
    "inference.linear": ("linear_of",),
    "inference.mcmc.ensembles": ("Limits",),
    "inference.mcmc.run": ("sample",),
    "inference.prior": ("GPrior", "HyperG", "ScalePrior", "ZellnerSiow", "prior"),
    "inference.summary": ("Summary", "summarize"),
    "rig.rotations": ("centrifuge", "oscillation", "rate_table", "vibration"),
    "rig.tumbles": ("positions", "static", "thermal", "tumble"),
    "rig.simulate": ("simulate",),
    "selection.decision": ("select",),
    "selection.enumerate": ("enumerate_models",),
    "selection.feature_library": ("feature_library",),
    "sensors.catalogue": ("sensor",),
    "sensors.noise": ("Noise", "NoiseRule"),
    "sensors.terms": ("library",),
}
"""Public names by their module, imported when a name is first used: the command line starts fast."""

_SHOWN = ("run", "select")
"""Names that give a result, which shows itself in a notebook."""

_HOME = {name: module for module, names in _NAMES.items() for name in names}


def __dir__() -> list[str]:
    return ["__version__", *_HOME]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'imubayes' has no attribute '{name}'")
    if name in _SHOWN:
        import_module("imubayes.reporting.notebook").equip()
    return getattr(import_module(f"imubayes.{_HOME[name]}"), name)
