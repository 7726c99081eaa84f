"""What a person can switch on and off in the scene."""

from typing import NamedTuple

import viser

from poseloom.viewer.stage import Stage


class Shown(NamedTuple):
    """What is to be seen."""

    sensors: bool = True
    names: bool = False
    contacts: bool = True
    trail: bool = True
    doubt: bool = True


class ViewOptions:
    """Boxes to tick, in the container that is open, and a button that puts the camera back.

    Args:
        gui: Where they go.
        stage: Whose camera is put back.
    """

    def __init__(self, gui: viser.GuiApi, stage: Stage) -> None:
        first = Shown()
        self._boxes = (
            gui.add_checkbox("Sensors", first.sensors),
            gui.add_checkbox("Sensor names", first.names),
            gui.add_checkbox("Standing feet", first.contacts),
            gui.add_checkbox("Trail", first.trail),
            gui.add_checkbox("Doubt as colour", first.doubt, hint="From the figure's own colour, sure, to yellow"),
        )
        shadows = gui.add_checkbox("Shadows", True, hint="Without them a slow computer or phone draws faster")
        shadows.on_update(lambda _: stage.shadows(shadows.value))
        gui.add_button("Reset view", icon=viser.Icon.FOCUS_CENTERED).on_click(self._put_back)
        self._stage = stage

    @property
    def shown(self) -> Shown:
        """What is ticked now."""
        return Shown(*(box.value for box in self._boxes))

    def _put_back(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        if event.client is not None:
            self._stage.frame_client(event.client)
