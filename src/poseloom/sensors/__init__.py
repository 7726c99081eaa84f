"""Body-worn sensors: layouts, placements on bones, samples and recordings of them."""

from poseloom.sensors.layout import SensorKind, SensorLayout, SensorSpec, imu_layout, layout, layout_names, make_layout
from poseloom.sensors.placement import Placement, default_placements, make_placement, place_sensors
from poseloom.sensors.recording import Recording, make_recording
from poseloom.sensors.sample import Sample, SensorStatus

__all__ = [
    "Placement",
    "Recording",
    "Sample",
    "SensorKind",
    "SensorLayout",
    "SensorSpec",
    "SensorStatus",
    "default_placements",
    "imu_layout",
    "layout",
    "layout_names",
    "make_layout",
    "make_placement",
    "make_recording",
    "place_sensors",
]
