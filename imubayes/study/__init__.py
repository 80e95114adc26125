"""The method, from a study's runs to its verdicts."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imubayes.study.method import check as check
    from imubayes.study.method import run as run


def __getattr__(name: str) -> object:
    """Import the method when it is first used: who reads a study file does without."""
    if name not in ("check", "run"):
        raise AttributeError(f"module 'imubayes.study' has no attribute '{name}'")
    from imubayes.study import method

    return getattr(method, name)
