"""Ground, light and the camera's place, for a desk's screen and for a phone's."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import viser

from poseloom.arrays import Array, Floats
from poseloom.rotations import heading_matrix, quat_from_matrix

WORLD = "/w"
"""The scene node on which everything stands that the person's world has in it."""

_FIELD_OF_VIEW = math.radians(32.0)
_HEIGHT, _MIDDLE = 2.5, 0.92
"""Metres that must be seen from the floor up, and the height of the figure's middle."""
_LIMB_SPAN = 1.7
"""Metres that one figure's limbs take to the sides, most of the time."""
_PHONE_WIDTH = 576
"""Pixels below which the panel lies across the bottom of the page, in place of beside the scene."""
_PHONE_SHAPE = 1.25
"""Height by width from which on a narrow picture is a phone's."""
_PHONE_SHARE = 0.52
"""Share of a phone's height, from the top, that the panel leaves to the figures."""
_ASIDE, _ABOVE = 0.42, 0.16
"""How far the camera stands to the figure's left, and above it, for each metre before it."""
_UNMOVED = 0.02
"""Metres up to which a camera stands where it was put."""
_FOLLOW_SLACK = 0.25
"""Metres that the figure may stray from the middle before the ground begins to move under it."""


@dataclass(frozen=True)
class View:
    """Where a camera stands.

    Attributes:
        position: Metres.
        look_at: The point about which it can be turned.
    """

    position: Floats[Array, "3"]
    look_at: Floats[Array, "3"]


class _Framed(NamedTuple):
    """How a visitor's camera was placed, for a picture of which size, and whether it has been seen there since."""

    size: tuple[int, int]
    view: View
    arrived: bool = False


def framing(width: int, height: int, figures: int = 1, spacing: float = 0.0) -> View:
    """A view that shows all figures whole, for a picture of this size in pixels.

    On a phone the figures stand in the upper part of the picture, for the panel covers the lower.

    Args:
        width: Pixels.
        height: Pixels.
        figures: How many stand side by side.
        spacing: Metres from one to the next.
    """
    # The picture's width, not the window's, is what is known: one that is not upright has the panel beside it.
    phone = width < _PHONE_WIDTH and height > _PHONE_SHAPE * width
    share = _PHONE_SHARE if phone else 1.0
    half = math.tan(_FIELD_OF_VIEW / 2)
    breadth = _LIMB_SPAN + (figures - 1) * spacing
    distance = max(_HEIGHT / share, breadth * height / max(width, 1)) / (2 * half)
    # The camera looks at the picture's middle, which on a phone lies below the figures' own middle.
    shift = 2 * half * distance * (0.5 - share / 2)
    look_at = np.array([0.0, _MIDDLE - shift, 0.0])
    # Several are seen more from the front, lest the nearest be much the largest.
    direction = np.array([_ASIDE / figures**2, _ABOVE, 1.0])
    return View(look_at + distance * direction / np.linalg.norm(direction), look_at)


class Stage:
    """The floor and the light, and a camera that goes along with whoever walks.

    Args:
        server: Where to build it.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._figures, self._spacing = 1, 0.0
        scene = server.scene
        scene.set_up_direction("+y")
        self._sun = _light(scene)
        self.world = scene.add_frame(WORLD, show_axes=False)
        _lay_floor(scene)
        camera = server.initial_camera
        view = framing(1280, 800)
        camera.position, camera.look_at = view.position, view.look_at
        camera.up, camera.fov = (0.0, 1.0, 0.0), _FIELD_OF_VIEW
        self._focus, self._turn = np.zeros(3), np.eye(3)
        self._framed: dict[int, _Framed] = {}
        server.on_client_connect(self._welcome)
        server.on_client_disconnect(self._farewell)

    def arrange(self, figures: int, spacing: float) -> None:
        """Says how many figures stand side by side, and frames them for everybody who is looking."""
        self._figures, self._spacing = figures, spacing
        for client in self._server.get_clients().values():
            self.frame_client(client)

    def frame_client(self, client: viser.ClientHandle) -> None:
        """Puts one visitor's camera where it shows all figures."""
        camera = client.camera
        size = (camera.image_width, camera.image_height)
        view = framing(*size, self._figures, self._spacing)
        self._framed[client.client_id] = _Framed(size, view)
        with client.atomic():
            camera.fov = _FIELD_OF_VIEW
            camera.up_direction = np.array([0.0, 1.0, 0.0])
            camera.position = view.position
            camera.look_at = view.look_at

    def _welcome(self, client: viser.ClientHandle) -> None:
        self.frame_client(client)
        client.camera.on_update(lambda _: self._looked(client))

    def _farewell(self, client: viser.ClientHandle) -> None:
        self._framed.pop(client.client_id, None)

    def _looked(self, client: viser.ClientHandle) -> None:
        """Frames the figures anew when the window has changed its shape, unless the person has moved the camera."""
        camera, framed = client.camera, self._framed.get(client.client_id)
        if framed is None:
            return
        size = (camera.image_width, camera.image_height)
        unmoved = bool(np.linalg.norm(camera.position - framed.view.position) < _UNMOVED)
        # A page takes its shape while it is told where its camera stands: not to be there yet is not to have moved.
        if size != framed.size and (unmoved or not framed.arrived):
            self.frame_client(client)
        else:
            self._framed[client.client_id] = _Framed(size, framed.view, framed.arrived or unmoved)

    def shadows(self, on: bool) -> None:
        """Draws shadows or leaves them out."""
        self._sun.cast_shadow = on

    def follow(self, root: Floats[Array, "3"]) -> None:
        """Moves the world under the camera so that who walks stays in the picture; the person can still turn it."""
        drift = (root - self._focus) * (1.0, 0.0, 1.0)
        far = float(np.linalg.norm(drift))
        if far > _FOLLOW_SLACK:
            self.centre(self._focus + drift * (1.0 - _FOLLOW_SLACK / far))

    def centre(self, point: Floats[Array, "3"]) -> None:
        """Puts a point of the floor into the middle at once."""
        self._focus = point * (1.0, 0.0, 1.0)
        self.world.position = -self._turn @ self._focus

    def face(self, heading: float) -> None:
        """Turns the world so that who has this heading (radians about the vertical, 0 towards +Z) faces the camera."""
        self._turn = heading_matrix(np.asarray(-heading))
        self.world.wxyz = quat_from_matrix(self._turn)
        self.centre(self._focus)

    def across(self, metres: float) -> Floats[Array, "3"]:
        """The way in the world that leads so far to the right in the picture."""
        return np.array([metres, 0.0, 0.0]) @ self._turn


def _light(scene: viser.SceneApi) -> viser.DirectionalLightHandle:
    """A sun before the figures on their right, a fainter light on their left, and a sky.

    viser's own sun leaves the fronts in the dark, and its picture of surroundings, which is there to light them, takes
    ten seconds to prepare on a slow computer.
    """
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(215, 215, 225), intensity=2.3)
    scene.add_light_directional("/fill", intensity=0.9, position=(2.5, 1.2, 3.0))
    return scene.add_light_directional("/sun", intensity=2.2, cast_shadow=True, position=(-1.2, 3.0, 2.0))


def _lay_floor(scene: viser.SceneApi) -> None:
    scene.add_grid(
        f"{WORLD}/floor",
        width=40.0,
        height=40.0,
        plane="xz",
        cell_size=0.5,
        section_size=1.0,
        cell_color=(222, 226, 232),
        section_color=(196, 202, 211),
        plane_color=(246, 247, 249),
        plane_opacity=1.0,
        shadow_opacity=0.22,
        fade_distance=30.0,
    )
