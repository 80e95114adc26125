"""Scenes of given motion, shared by tests."""

from imubayes.scenes import BODY, scene_of


def recorded(name, t, force, rate, *, temperature=None, attitude=None, duration=None):
    """Scene of times (n,), force and rate (n, 3) along x, y and z, and a temperature (n,) if there is one."""
    channels = {f"{q}_{axis}": v[:, c] for q, v in (("f", force), ("w", rate)) for c, axis in enumerate(BODY)}
    if temperature is not None:
        channels["T"] = temperature
    return scene_of(name, t, channels, duration, (), attitude)
