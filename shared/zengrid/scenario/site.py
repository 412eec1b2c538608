"""Place of a market, and the output of its PV systems under a clear sky, computed with pvlib.

pvlib is needed once for each place. It computes the position of the sun and the clear-sky irradiance, which are kept in
the user's cache (those of the built-in scenarios ship with zengrid). A short formula then gives the output for any tilt
and azimuth.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from zengrid.errors import ScenarioError
from zengrid.scenario.home_spec import Spec

Floats = NDArray[np.float64]

STEPS = 288
"""Parts of a day for which the sun is computed: 5 minutes each, at the middle."""

ALBEDO = 0.25
AIR_C = 20.0
TEMPERATURE_COEFFICIENT = -0.004
LOSSES = 0.14
# Cell temperature over air temperature per irradiance: SAPM, open rack, glass-glass, no wind (exp(a) + dT / 1000).
HEATING_PER_WM2 = math.exp(-3.47) + 3.0 / 1000.0

_SHIPPED = Path(__file__).parent / "data"
# Any year without a leap day: the path of the sun on a day of the year hardly depends on the year.
_YEAR = 2023


class Site(Spec):
    """The place of a market. Homes without their own tilt and azimuth use those given here."""

    latitude: float = Field(ge=-90.0, le=90.0, description="North is positive [deg].")
    longitude: float = Field(ge=-180.0, le=180.0, description="East is positive [deg].")
    timezone: str = Field(description="IANA name, such as America/Los_Angeles.")
    altitude_m: float = Field(default=0.0, ge=-500.0, le=9000.0, description="Above the sea [m].")
    tilt_deg: float = Field(default=30.0, ge=0.0, le=90.0, description="Slope of PV, if a home gives none [deg].")
    azimuth_deg: float = Field(default=180.0, ge=0.0, le=360.0, description="Direction of PV, 180 is south [deg].")
    date: str = Field(
        default="04-15",
        pattern=r"^(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])$",
        description="Month and day of the sun on a typical day; measured days have their own dates.",
    )


def clear_sky(site: Site, dates: Sequence[tuple[int, int]] | None = None) -> Floats:
    """Position of the sun and irradiance over some days, ``(date, step, 6)``.

    Parameters
    ----------
    site:
        The place.
    dates:
        Months and days, in standard time; None: the site's own date, in local time.

    Returns
    -------
    Direction to the sun as a unit vector east, north, up [-]; direct normal, diffuse horizontal and global horizontal
    irradiance [W/m2].
    """
    days = list(dates) if dates is not None else [(int(site.date[:2]), int(site.date[3:]))]
    name = sky_file(site, dates)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "zengrid"
    for folder in (_SHIPPED, cache):
        with suppress(OSError, ValueError, EOFError):
            return np.asarray(np.load(folder / name), dtype=np.float64)
    sky = compute_clear_sky(site, days, standard_time=dates is not None)
    with suppress(OSError):  # If the cache cannot be written, the sky is computed again next time.
        cache.mkdir(parents=True, exist_ok=True)
        part = cache / f"{name}.{os.getpid()}"
        with part.open("wb") as file:
            np.save(file, sky)
        part.replace(cache / name)
    return sky


def sky_file(site: Site, dates: Sequence[tuple[int, int]] | None) -> str:
    """File name of a clear sky in the cache."""
    import hashlib

    days = site.date if dates is None else ",".join(f"{month:02d}-{day:02d}" for month, day in dates)
    span = days if len(days) == len("04-15") else hashlib.sha256(days.encode()).hexdigest()[:16]
    place = f"{site.latitude:.4f}_{site.longitude:.4f}_{site.altitude_m:.0f}m_{site.timezone.replace('/', '-')}"
    return f"sky_{place}_{'clock' if dates is None else 'standard'}_{span}.npy"


def compute_clear_sky(site: Site, dates: Sequence[tuple[int, int]], *, standard_time: bool) -> Floats:
    """Compute ``clear_sky`` with pvlib: NREL's solar position, Ineichen's clear sky with local monthly turbidity."""
    try:
        import pandas as pd
        import pvlib
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in ("pandas", "pvlib", "scipy"):
            raise
        raise ScenarioError(
            f"site: {missing} is not installed; needed for the sun of a new site: pip install pandas pvlib scipy, "
            "or in containers the large image: docker build --build-arg IMAGE=learn --tag zengrid:learn ."
        ) from None

    from zengrid.scenario.readers.stamps import zone

    local = zone(site.timezone, "site.timezone")
    try:
        midnights = pd.DatetimeIndex(
            [pd.Timestamp(_YEAR, month, 28 if (month, day) == (2, 29) else day) for month, day in dates]
        ).tz_localize(local)
    except ValueError as error:
        raise ScenarioError(f"site.date = {site.date!r}: no such day ({error})") from None
    if standard_time:
        # Measured days are in standard time: in summer their midnight is an hour after local midnight.
        midnights = pd.DatetimeIndex([midnight + (midnight.dst() or timedelta()) for midnight in midnights])
    steps = pd.timedelta_range("2min30s", periods=STEPS, freq="5min")
    starts = midnights.tz_convert("UTC").tz_localize(None)
    times = pd.DatetimeIndex(np.add.outer(starts.to_numpy(), steps.to_numpy()).ravel(), tz="UTC")
    place = pvlib.location.Location(site.latitude, site.longitude, "UTC", site.altitude_m)
    with warnings.catch_warnings():
        # pvlib uses a call that pandas 3 deprecates.
        warnings.simplefilter("ignore", DeprecationWarning)
        position = place.get_solarposition(times)
        sky = place.get_clearsky(times, solar_position=position)
    zenith, azimuth = np.radians(position["apparent_zenith"]), np.radians(position["azimuth"])
    columns = (
        np.sin(zenith) * np.sin(azimuth), np.sin(zenith) * np.cos(azimuth), np.cos(zenith),
        sky["dni"], sky["dhi"], sky["ghi"],
    )  # fmt: skip
    return np.stack([np.asarray(c, dtype=np.float64) for c in columns], axis=-1).reshape(len(dates), STEPS, 6)


def pv_output(sky: Floats, tilt_deg: float, azimuth_deg: float) -> Floats:
    """Output of one kW of PV under a clear sky, ``(date, step)``, as PVWatts computes it.

    Irradiance on the panel: direct, isotropic diffuse, and reflected from the ground (albedo 0.25). Cells warm up as in
    SAPM, open rack, in still air of 20 degrees C; -0.4 %/K; 14 % losses; the inverter limits to the rated power.
    Source: Dobos, "PVWatts Version 5 Manual", NREL/TP-6A20-62641, with pvlib's and PVWatts' default values.

    Returns
    -------
    Mean power per rated power. [kW/kW]
    """
    tilt, azimuth = math.radians(tilt_deg), math.radians(azimuth_deg)
    east, north, up, direct, diffuse, horizontal = np.moveaxis(sky, -1, 0)
    facing = (
        east * (math.sin(tilt) * math.sin(azimuth)) + north * (math.sin(tilt) * math.cos(azimuth)) + up * math.cos(tilt)
    )
    irradiance = (
        direct * np.maximum(facing, 0.0)
        + diffuse * ((1.0 + math.cos(tilt)) / 2.0)
        + horizontal * (ALBEDO * (1.0 - math.cos(tilt)) / 2.0)
    )
    cell_c = AIR_C + irradiance * HEATING_PER_WM2
    power = irradiance / 1000.0 * (1.0 + TEMPERATURE_COEFFICIENT * (cell_c - 25.0)) * (1.0 - LOSSES)
    return np.asarray(np.minimum(power, 1.0))
