"""Sources of a scenario's profiles: data shipped with zengrid, or files in one of several formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo

from zengrid.errors import ScenarioError
from zengrid.scenario.home_spec import Spec
from zengrid.scenario.profiles import Profiles

_SHIPPED = Path(__file__).parent / "data"
_HOUR = 60


def _absolute(path: Path, info: ValidationInfo) -> Path:
    """Make a path absolute; relative paths start at the folder of the scenario file."""
    folder = (info.context or {}).get("folder", Path.cwd())
    return Path(folder, path.expanduser()).resolve()


DataPath = Annotated[Path, AfterValidator(_absolute)]
ContentHash = Annotated[
    str | None,
    Field(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the files; if it is given, other content is refused."),
]


class BuiltinData(Spec):
    """Profiles of one typical day that ship with zengrid."""

    kind: Literal["builtin"] = Field(default="builtin", description="Shipped with zengrid.")
    name: Literal["paper", "village"] = Field(default="paper", description="Which of the shipped profiles.")

    def files(self, slot_minutes: int) -> tuple[Path, ...]:
        """The file; ``paper`` has a separate one for whole hours, because its hourly values are rounded separately."""
        step = _HOUR if slot_minutes % _HOUR == 0 and self.name == "paper" else 15
        return (_SHIPPED / f"{self.name}_{step}min.csv",)

    def read(self, files: tuple[Path, ...]) -> Profiles:
        """All profiles at the file's own step."""
        from zengrid.scenario.readers.plain_csv import read_csv

        return read_csv(files[0], pv_rated_kw=4.0)


class CsvData(Spec):
    """A plain CSV: a time stamp, and PV and load columns with their unit."""

    kind: Literal["csv"] = Field(description="A plain CSV.")
    path: DataPath = Field(description="The file; relative to the scenario file.")
    pv_rated_kw: float | dict[str, float] | None = Field(
        default=None, description="Rated power of the measured PV: one number, or one for each name [kW]."
    )
    timezone: str | None = Field(default=None, description="IANA name; null: that of the site.")
    sha256: ContentHash = None

    def files(self, slot_minutes: int) -> tuple[Path, ...]:
        """The file."""
        return (self.path,)

    def read(self, files: tuple[Path, ...]) -> Profiles:
        """All profiles at the file's own step."""
        from zengrid.scenario.readers.plain_csv import read_csv

        return read_csv(files[0], self.pv_rated_kw, self.timezone)


class CityLearnData(Spec):
    """A folder of CityLearn building files."""

    kind: Literal["citylearn"] = Field(description="CityLearn building files.")
    path: DataPath | None = Field(default=None, description="The folder; can be given when the scenario is loaded.")
    sha256: ContentHash = None

    def files(self, slot_minutes: int) -> tuple[Path, ...]:
        """The folder's building files."""
        from zengrid.scenario.readers.citylearn import SOURCE

        if self.path is None:
            raise ScenarioError(f"data.path is not given, and this scenario uses measured homes. {SOURCE}.")
        if not self.path.is_dir():
            raise ScenarioError(f"data.path = {self.path}: is not a folder. {SOURCE}.")
        return tuple(sorted(self.path.glob("Building_*.csv")))

    def read(self, files: tuple[Path, ...]) -> Profiles:
        """All profiles, hourly."""
        from zengrid.scenario.readers.citylearn import read_citylearn

        assert self.path is not None  # ``files`` has checked it
        return read_citylearn(self.path)


class CaisoData(Spec):
    """Exports of CAISO OASIS: shapes of demand and of solar output."""

    kind: Literal["caiso"] = Field(description="CAISO OASIS exports.")
    load: DataPath = Field(description="CSV of the report SLD_FCST; relative to the scenario file.")
    renewables: DataPath | None = Field(default=None, description="CSV of the report SLD_REN_FCST, for PV.")
    area: str = Field(default="CA ISO-TAC", description="TAC_AREA_NAME whose demand is used.")
    market_run: str | None = Field(default=None, description="MARKET_RUN_ID to use; null if the files hold only one.")
    solar_peak_kw: float = Field(
        default=0.75, gt=0.0, le=1.0, description="Output per rated kW that the highest solar value represents [kW]."
    )
    sha256: ContentHash = None

    def files(self, slot_minutes: int) -> tuple[Path, ...]:
        """One or two files."""
        return (self.load,) if self.renewables is None else (self.load, self.renewables)

    def read(self, files: tuple[Path, ...]) -> Profiles:
        """Both shapes at the files' own step."""
        from zengrid.scenario.readers.caiso import read_caiso

        return read_caiso(self.load, self.renewables, self.area, self.market_run, self.solar_peak_kw)


Data = Annotated[BuiltinData | CsvData | CityLearnData | CaisoData, Field(discriminator="kind")]

_READ: dict[tuple[object, ...], Profiles] = {}
_READ_MAX = 4


def read_profiles(data: BuiltinData | CsvData | CityLearnData | CaisoData, slot_minutes: int) -> Profiles:
    """Read a data source as means over slots. Recent results are cached while their files do not change.

    Raises
    ------
    ScenarioError
        A file is missing or invalid, or has another hash than the scenario says.
    """
    files = data.files(slot_minutes)
    try:
        states = tuple((str(file), file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    except OSError as error:
        raise ScenarioError(f"{error.filename}: cannot be read ({error.strerror}); needed: a CSV file") from None
    key = (data.model_dump_json(), slot_minutes, states)
    if key not in _READ:
        if (
            not isinstance(data, BuiltinData)
            and data.sha256 is not None
            and (found := content_hash(files)) != data.sha256
        ):
            raise ScenarioError(
                f"{files[0].parent if len(files) > 1 else files[0]}: the content has changed (SHA-256 {found}); "
                f"needed: {data.sha256}, as the scenario says"
            )
        while len(_READ) >= _READ_MAX:
            del _READ[next(iter(_READ))]
        _READ[key] = data.read(files).resampled(24 * _HOUR // slot_minutes)
    return _READ[key]


def content_hash(files: tuple[Path, ...]) -> str:
    """SHA-256 over names and bytes of files."""
    import hashlib

    digest = hashlib.sha256()
    for file in files:
        content = file.read_bytes()
        digest.update(f"{file.name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()
