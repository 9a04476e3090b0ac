"""The six-wheel robot of section 3.3 as settings: its measures, springs, motors and the tolerances it is built to."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from sensor_model.settings import ClockDeg, Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Robot(Settings):
    """Sprung legs with two driven omni wheels in tandem each, and two end wheels that turn it about the pipe's axis.

    At `bore_radius_mm` every leg stands at the middle of its travel and presses with its preload. The end wheels stand
    side by side along the pipe, one before and one behind the legs; they roll around the wall and slide along it.
    """

    leg_count: Annotated[int, Field(ge=3, le=6)] = 3
    first_leg_clock_deg: ClockDeg = 60.0
    bore_radius_mm: Positive = 76.2
    leg_stiffness_n_m: Positive = 1500.0
    leg_preload_n: Positive = 10.0
    leg_damping_n_s_m: Positive = 5.0
    leg_travel_mm: Positive = 8.0
    leg_mass_kg: Positive = 0.06

    wheel_radius_mm: Annotated[float, Field(gt=2)] = 19.0
    wheel_width_mm: Positive = 10.0
    wheel_crown_radius_mm: Positive = 20.0
    wheel_spacing_mm: Positive = 80.0
    wheel_mass_kg: Positive = 0.02
    # The rim of an omni wheel is a ring of rollers: its radius swells and shrinks by this much either way. Six hard
    # wheels on stiff legs are over-constrained: from about 0.01 mm some lift off now and then.
    roller_ripple_mm: Annotated[float, Field(ge=0, le=0.5)] = 0.005
    roller_count: Annotated[int, Field(ge=3, le=40)] = 10
    # How fast a leg's second wheel follows its first; 4 ms gives 0.1 mm at the rim for 1 N, a slack belt of 20 ms 2 mm.
    belt_ms: Annotated[float, Field(ge=2, le=100)] = 4.0
    wheel_friction: Positive = 0.6
    # A roller's low friction still slides and steals grip from the driven direction: keep it tiny.
    roller_friction: Annotated[float, Field(gt=0, le=0.003)] = 0.001

    end_wheel_radius_mm: Annotated[float, Field(gt=2)] = 15.0
    end_wheel_ahead_mm: Positive = 100.0
    end_wheel_clock_deg: ClockDeg = 180.0
    end_wheel_stiffness_n_m: Positive = 500.0
    end_wheel_preload_n: Positive = 3.0

    chassis_radius_mm: Positive = 32.0
    chassis_length_mm: Positive = 180.0
    chassis_mass_kg: Positive = 0.5
    # At the tail, opposite the sensor, where they balance it.
    batteries_mass_kg: Positive = 0.4
    batteries_behind_mm: NotNegative = 80.0
    sensor_radius_mm: Positive = 15.0
    sensor_length_mm: Positive = 80.0
    sensor_mass_kg: Positive = 0.25
    camera_ahead_mm: Positive = 180.0

    motor_torque_limit_n_mm: Positive = 300.0
    motor_inertia_kg_mm2: Positive = 300.0  # the rotor's, seen through the 603:1 gear
    motor_friction_n_mm: NotNegative = 0.0  # at the wheel's shaft
    # A motor's torque falls with its speed, from its limit at rest to nothing at the no-load speed of a full battery;
    # left out, it does not. `supply_pct` is what is left of the battery's voltage.
    motor_no_load_turns_s: Positive | None = None
    supply_pct: Annotated[float, Field(gt=0, le=120)] = 100.0
    motor_servo_hz: Annotated[float, Field(gt=0, le=40)] = 15.0

    # What is wrong with this one robot, leg by leg; left out, nothing is. The motors go by the sizes that should be.
    wheel_diameter_error_pct: tuple[Annotated[float, Field(ge=-20, le=20)], ...] = ()
    leg_preload_error_pct: tuple[Annotated[float, Field(ge=-90, le=200)], ...] = ()
    wheel_steer_deg: Annotated[float, Field(ge=-10, le=10)] = 0.0
    end_wheel_steer_deg: Annotated[float, Field(ge=-10, le=10)] = 0.0

    # What each robot is built to, as standard deviations; a zero switches its draw off.
    preload_tolerance_pct: NotNegative = 3.0
    wheel_toe_tolerance_deg: NotNegative = 0.05
    end_wheel_skew_tolerance_deg: NotNegative = 0.05

    @model_validator(mode="after")
    def _wheels_clear_the_chassis(self) -> Robot:
        room = self.bore_radius_mm - self.leg_travel_mm - self.chassis_radius_mm
        if max(self.wheel_radius_mm, self.end_wheel_radius_mm) >= room:
            raise ValueError(f"between chassis and wall is room for a wheel of less than {room} mm radius")
        if self.wheel_spacing_mm < 2 * self.wheel_radius_mm:
            raise ValueError("wheel_spacing_mm must be at least two wheel radii")
        for name in ("wheel_diameter_error_pct", "leg_preload_error_pct"):
            if len(getattr(self, name)) not in (0, self.leg_count):
                raise ValueError(f"{name} must have a number for each of {self.leg_count} legs, or none")
        return self

    @property
    def leg_wheel_radius_mm(self) -> Float[np.ndarray, "legs"]:
        """What each leg's wheels really measure."""
        return self.wheel_radius_mm * (1 + np.array(self.wheel_diameter_error_pct or [0.0] * self.leg_count) / 100)

    @property
    def leg_clock_rad(self) -> Float[np.ndarray, "legs"]:
        """Angle of every leg around the robot."""
        return np.radians(self.first_leg_clock_deg) + 2 * np.pi * np.arange(self.leg_count) / self.leg_count

    @property
    def behind_camera_mm(self) -> float:
        """How far the robot reaches behind its camera."""
        return self.camera_ahead_mm + max(
            self.end_wheel_ahead_mm + self.end_wheel_radius_mm, self.chassis_length_mm / 2
        )


class Build(Settings):
    """How one robot came out of the workshop: each leg's preload, each wheel's axle askew, its rollers' position."""

    preload_n: tuple[float, ...]
    askew_rad: tuple[float, ...]
    roller_phase_rad: tuple[float, ...]


def draw_build(robot: Robot, rng: np.random.Generator) -> Build:
    """One robot within its tolerances: normal draws, wheels in the order of `robot_model.wheel_names`."""
    preload = robot.leg_preload_n * (1 + robot.preload_tolerance_pct / 100 * rng.standard_normal(robot.leg_count))
    preload = preload * (1 + np.array(robot.leg_preload_error_pct or [0.0] * robot.leg_count) / 100)
    toe = robot.wheel_steer_deg + robot.wheel_toe_tolerance_deg * rng.standard_normal(2 * robot.leg_count)
    skew = robot.end_wheel_steer_deg + robot.end_wheel_skew_tolerance_deg * rng.standard_normal(2)
    return Build(
        preload_n=tuple(preload),
        askew_rad=tuple(np.radians(np.concatenate([toe, skew]))),
        roller_phase_rad=tuple(rng.uniform(0, 2 * np.pi, 2 * robot.leg_count)),
    )


SIZES = {
    "4-inch": Robot(
        bore_radius_mm=51.1,
        leg_preload_n=8.0,
        wheel_radius_mm=12.0,
        wheel_width_mm=8.0,
        wheel_crown_radius_mm=13.0,
        wheel_spacing_mm=60.0,
        end_wheel_radius_mm=10.0,
        end_wheel_ahead_mm=85.0,
        end_wheel_preload_n=2.0,
        chassis_radius_mm=20.0,
        chassis_length_mm=150.0,
        chassis_mass_kg=0.3,
        batteries_mass_kg=0.3,
        batteries_behind_mm=70.0,
        camera_ahead_mm=165.0,
        motor_torque_limit_n_mm=200.0,
    ),
    "6-inch": Robot(),
    "8-inch": Robot(
        bore_radius_mm=101.4,
        leg_travel_mm=14.0,
        leg_stiffness_n_m=2500.0,
        leg_preload_n=18.0,
        wheel_radius_mm=25.0,
        wheel_width_mm=12.0,
        wheel_crown_radius_mm=26.0,
        wheel_spacing_mm=110.0,
        wheel_mass_kg=0.04,
        end_wheel_radius_mm=20.0,
        end_wheel_ahead_mm=130.0,
        end_wheel_stiffness_n_m=800.0,
        end_wheel_preload_n=5.0,
        chassis_radius_mm=42.0,
        chassis_length_mm=230.0,
        chassis_mass_kg=1.0,
        batteries_mass_kg=0.7,
        batteries_behind_mm=95.0,
        camera_ahead_mm=215.0,
        motor_torque_limit_n_mm=600.0,
        motor_inertia_kg_mm2=600.0,
    ),
}
"""Robots by the nominal size of the pipe that they are built for (Schedule 40 PVC or thick polyethylene)."""
