"""The settings of every stage of the measurement in one frozen object: what tuning exports and the robot loads."""

from __future__ import annotations

from algorithms.decode import DecodeSettings
from algorithms.localisation.odometry import OdometrySettings
from algorithms.registration import AnyRegistration, CylinderSettings
from algorithms.sizing.measure import SizingSettings
from algorithms.wall_map import MapSettings
from sensor_model.settings import Settings


class Method(Settings):
    """One way to measure."""

    decode: DecodeSettings = DecodeSettings()
    localisation: OdometrySettings = OdometrySettings()
    registration: AnyRegistration = CylinderSettings()
    map: MapSettings = MapSettings()
    sizing: SizingSettings = SizingSettings()
