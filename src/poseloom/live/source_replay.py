"""Sources without any device: a recording played again, and virtual sensors on a motion."""

import asyncio
import time

from poseloom.live.readings import Packet, readings_of_sample
from poseloom.live.source import Listener, Needs
from poseloom.sensors import Recording


class ReplaySource:
    """A recording, sample by sample.

    Args:
        recording: The samples.
        title: What it is, in words.
        speed: How many times faster than it was recorded; the session's time then runs as much faster.
        loop: Whether to begin again at its end.
    """

    def __init__(self, recording: Recording, title: str = "", speed: float = 1.0, loop: bool = False) -> None:
        self.recording = recording
        self.layout = recording.layout
        self.speed, self.loop = speed, loop
        self.name = title or f"replay of {recording.name}"

    @property
    def needs(self) -> Needs:
        """What must arrive, and what to do where it does not."""
        return Needs(
            begin="the recording has come to a pause, or its samples are empty",
            remedy="`poseloom info` shows what the recording holds",
            absent="the recording has no readings of them here",
        )

    async def run(self, listener: Listener) -> None:
        """See `Source`. Ends with the recording, unless it is looped."""
        times = self.recording.times - self.recording.times[0]
        cycle = float(times[-1]) + 1.0 / self.layout.rate
        begin, turn = time.monotonic(), 0
        while True:
            for index in range(len(self.recording)):
                moment = turn * cycle + float(times[index])
                await asyncio.sleep(max(0.0, begin + moment / self.speed - time.monotonic()))
                readings = readings_of_sample(self.recording.sample(index), self.layout)
                packet = Packet(readings, moment, whole=True, paced=self.speed != 1.0)
                listener.packet(packet, time.monotonic(), self.name)
            if not self.loop:
                return
            turn += 1
