"""A calibration within a session: begun on demand, led through, computed beside the session, kept in a file."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from poseloom.calibration.calibration import Calibration, write_calibration
from poseloom.calibration.calibration import Level as VerdictLevel
from poseloom.errors import PoseloomError
from poseloom.live.calibrating import CalibrationRun
from poseloom.live.contract import Calibrate, CalibrationProgress, Level
from poseloom.live.sinks.outlet import Tell
from poseloom.sensors import Sample, SensorLayout


class CalibrationDesk:
    """Runs at most one calibration at a time. All calls come from the session's event loop, but for `progress`.

    Args:
        layout: The sensors.
        file: Names a file for the result.
        tell: Where the outcome is told.
        take: Called with a calibration that was made.

    Attributes:
        failures: Calibrations that could not be kept, in words.
    """

    def __init__(
        self, layout: SensorLayout, file: Callable[[], Path], tell: Tell, take: Callable[[Calibration], None]
    ) -> None:
        self._layout, self._file, self._tell, self._take = layout, file, tell, take
        self.failures: list[str] = []
        self._run: CalibrationRun | None = None
        self._computing: asyncio.Task[None] | None = None

    def begin(self, command: Calibrate, newest: Sample | None) -> None:
        """Begins one; a running one is left.

        Raises:
            PoseloomError: if nothing is heard, or the sensors cannot be calibrated by poses.
        """
        if newest is None:
            raise PoseloomError("nothing has been heard yet", remedy="Switch the sensors on, then calibrate")
        self._run = CalibrationRun(command, self._layout, newest.time)

    def cancel(self) -> None:
        """Leaves the running one."""
        self._run = None

    def hear(self, sample: Sample) -> None:
        """Passes on a sample, and computes once the last pose has been held."""
        run = self._run
        if run is None or run.computing:
            return
        run.hear(sample)
        if run.is_over(sample.time):
            run.computing = True
            self._computing = asyncio.ensure_future(self._compute(run))

    def progress(self, time: float) -> CalibrationProgress | None:
        """Where it stands at a session time; None while none runs."""
        run = self._run
        return None if run is None else run.progress(time)

    async def _compute(self, run: CalibrationRun) -> None:
        try:
            calibration = await asyncio.to_thread(run.result)
        except PoseloomError as error:
            self._tell(Level.ERROR, f"the calibration failed: {error}")
            return
        finally:
            cancelled = self._run is not run
            if not cancelled:
                self._run = None
        if not cancelled:
            self._keep(calibration)
            self._take(calibration)

    def _keep(self, calibration: Calibration) -> None:
        path = self._file()
        try:
            write_calibration(calibration, path)
            self._tell(Level.NOTE, f"calibrated; kept as {path}")
        except (PoseloomError, OSError) as error:
            reason = error.strerror or str(error) if isinstance(error, OSError) else str(error)
            text = f"calibrated, but the calibration cannot be kept: {path} cannot be written ({reason})"
            self.failures.append(text)
            self._tell(
                Level.ERROR, f"{text}. It holds until the session ends; make room and calibrate again to keep it"
            )
        for verdict in calibration.verdicts:
            self._tell(Level.NOTE if verdict.level is VerdictLevel.GOOD else Level.WARNING, str(verdict))
