"""PV under a clear sky: the shipped tables, pvlib's own numbers, and the cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from make_scenario_data import write_data
from zengrid.errors import ScenarioError
from zengrid.scenario import Scenario, load
from zengrid.scenario import site as site_module
from zengrid.scenario.profiles import resample
from zengrid.scenario.readers.csv_table import CsvTable
from zengrid.scenario.site import Site, clear_sky, compute_clear_sky, pv_output, sky_file

SHIPPED = Path(site_module.__file__).parent / "data"
BERLIN = Site(latitude=52.5, longitude=13.4, timezone="Europe/Berlin", altitude_m=40, date="06-21")


@pytest.fixture
def place(paper: Scenario) -> Site:
    assert paper.site is not None
    return paper.site


def test_the_shipped_tables_are_those_that_are_computed(tmp_path: Path) -> None:
    write_data(tmp_path)
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in SHIPPED.iterdir() if not path.name.startswith("paper_"))
    for name in made:
        if name.endswith(".npy"):
            # Another pvlib may compute the sun a little differently.
            np.testing.assert_allclose(np.load(tmp_path / name), np.load(SHIPPED / name), rtol=1e-3, atol=0.5)
        else:
            assert (tmp_path / name).read_text() == (SHIPPED / name).read_text()


@pytest.mark.parametrize("name", ["paper", "village", "city"])
def test_built_in_scenarios_need_no_pvlib(name: str) -> None:
    site = load(name).site
    assert site is not None
    assert (SHIPPED / sky_file(site, None)).is_file()


@pytest.mark.parametrize(("minutes", "error_kw"), [(15, 0.03), (60, 0.03)])
def test_the_papers_pv_is_4_kw_in_fresno_on_15_april(place: Site, minutes: int, error_kw: float) -> None:
    pv_kw = 4 * resample(pv_output(clear_sky(place), 30, 180), 1440 // minutes)[0]
    given = CsvTable(SHIPPED / f"paper_{minutes}min.csv").numbers("pv_kw")
    np.testing.assert_allclose(pv_kw, given, atol=error_kw)
    assert pv_kw.mean() == pytest.approx(given.mean(), rel=0.005)


def test_it_is_pvlibs_pvwatts_chain(place: Site) -> None:
    """The formula is PVWatts with an isotropic sky: recomputed here with pvlib's own functions for many directions."""
    import pvlib

    sky = clear_sky(place)
    east, north, up, dni, dhi, ghi = sky[0].T
    zenith, azimuth = np.degrees(np.arccos(up)), np.degrees(np.arctan2(east, north)) % 360
    sapm = pvlib.temperature.TEMPERATURE_MODEL_PARAMETERS["sapm"]["open_rack_glass_glass"]
    for tilt in (0, 20, 30, 60, 90):
        for facing in (0, 90, 135, 180, 270):
            parts = pvlib.irradiance.get_total_irradiance(tilt, facing, zenith, azimuth, dni, ghi, dhi, albedo=0.25)
            irradiance = parts["poa_global"]
            cell_c = pvlib.temperature.sapm_cell(irradiance, 20.0, 0.0, **sapm)
            wanted = pvlib.pvsystem.pvwatts_dc(irradiance, cell_c, 1.0, -0.004) * 0.86
            np.testing.assert_allclose(pv_output(sky, tilt, facing)[0], np.minimum(wanted, 1.0), atol=1e-9)


def test_measured_days_have_their_dates_on_standard_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    clock = pv_output(clear_sky(BERLIN), 30, 180)[0]
    standard = pv_output(clear_sky(BERLIN, [(6, 21), (12, 21)]), 30, 180)
    np.testing.assert_allclose(standard[0][:-12], clock[12:], atol=1e-4)  # clocks are an hour ahead in summer
    assert standard[1].mean() < 0.4 * standard[0].mean()


def test_what_was_computed_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = clear_sky(BERLIN)
    assert [path.name for path in (tmp_path / "zengrid").iterdir()] == [sky_file(BERLIN, None)]
    monkeypatch.setattr(site_module, "compute_clear_sky", None)
    np.testing.assert_array_equal(clear_sky(BERLIN), first)


def test_a_spoilt_or_forbidden_cache_is_no_obstacle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = clear_sky(BERLIN)
    (tmp_path / "zengrid" / sky_file(BERLIN, None)).write_bytes(b"spoilt")
    np.testing.assert_array_equal(clear_sky(BERLIN), first)
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    np.testing.assert_array_equal(clear_sky(BERLIN), first)


def test_places_that_cannot_be_are_told() -> None:
    with pytest.raises(ScenarioError, match=r'site.timezone = "Moon": permitted: an IANA time zone'):
        compute_clear_sky(BERLIN.model_copy(update={"timezone": "Moon"}), [(1, 1)], standard_time=True)
    with pytest.raises(ScenarioError, match=r"site.date = '02-30': no such day"):
        compute_clear_sky(BERLIN.model_copy(update={"date": "02-30"}), [(2, 30)], standard_time=False)
    assert compute_clear_sky(BERLIN, [(2, 29)], standard_time=True).shape == (1, 288, 6)
