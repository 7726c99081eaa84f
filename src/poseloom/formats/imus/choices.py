"""What a user may say about a recording of inertial sensors where the file does not, or says it wrongly."""

from dataclasses import dataclass

from poseloom.formats.column_map import ColumnMap


@dataclass(frozen=True)
class ImuChoices:
    """Choices that go before what names and values tell; empty or None where these shall decide.

    Attributes:
        rate: Samples a second, for files that count samples.
        time_unit: s, ms, us, ns, `index` (count the rows), or seconds of one tick.
        accel_unit: m/s2, g, mg, or m/s^2 in one unit.
        gyro_unit: rad/s, deg/s, mdps, or rad/s in one unit.
        quat_order: wxyz, xyzw, or `none` to leave orientations out.
        columns: Which columns of a table hold what.
    """

    rate: float | None = None
    time_unit: str = ""
    accel_unit: str = ""
    gyro_unit: str = ""
    quat_order: str = ""
    columns: ColumnMap | None = None

    def setting(self, name: str, option: str) -> str:
        """An option, or else what the column map says."""
        return option or (self.columns.get(name) if self.columns is not None else "")
