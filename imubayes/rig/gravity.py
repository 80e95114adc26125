"""Normal gravity of the WGS-84 ellipsoid, for a test whose only reference is |f| = g."""

from __future__ import annotations

import math
from typing import Annotated

from imubayes.units import Angle, Key, Metres

SEMI_MAJOR_AXIS = 6378137.0
"""m, WGS-84 (NIMA TR8350.2, table 3.1)."""
FLATTENING = 1.0 / 298.257223563
"""WGS-84."""
GRAVITY_AT_EQUATOR = 9.7803253359
"""m/s^2, WGS-84 (TR8350.2, table 3.4)."""
SOMIGLIANA_CONSTANT = 0.00193185265241
"""k = (b gamma_p)/(a gamma_e) - 1, WGS-84 (TR8350.2, table 3.4)."""
ECCENTRICITY_SQUARED = 0.00669437999014
"""First eccentricity squared, WGS-84."""
ROTATION_RATIO = 0.00344978650684
"""m = omega^2 a^2 b / GM, WGS-84 (TR8350.2, table 3.4)."""


def normal_gravity(
    latitude: Annotated[Angle, Key("geodetic, north positive", "45.4 deg")],
    height: Annotated[Metres, Key("above the ellipsoid", "12 m")],
) -> float:
    """Gravity of the reference ellipsoid at a place, m/s^2.

    Somigliana's closed formula on the ellipsoid, continued upwards to second order in the height
    (TR8350.2, equations 4-1 and 4-3). Local anomalies, which reach 5e-4 m/s^2 in hills, are not in it: a
    gravimeter's value is better.

    Examples
    --------
    >>> round(normal_gravity(0.0, 0.0), 7), round(normal_gravity(math.pi / 2.0, 0.0), 7)
    (9.7803253, 9.8321849)
    """
    sin2 = math.sin(latitude) ** 2
    on_ellipsoid = GRAVITY_AT_EQUATOR * (1.0 + SOMIGLIANA_CONSTANT * sin2)
    on_ellipsoid /= math.sqrt(1.0 - ECCENTRICITY_SQUARED * sin2)
    slope = 1.0 + FLATTENING + ROTATION_RATIO - 2.0 * FLATTENING * sin2
    relative = height / SEMI_MAJOR_AXIS
    return on_ellipsoid * (1.0 - 2.0 * slope * relative + 3.0 * relative**2)
