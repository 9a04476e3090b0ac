"""Every equation, figure and table of the paper: what it is, where it is computed, what makes it, and what it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from scenarios.paper import attitude_checks as attitude
from scenarios.paper import cylinder_checks as cylinder
from scenarios.paper import made
from scenarios.paper import merit_checks as merit
from scenarios.paper.checked import Found

GEOMETRY, VARIANCE = "sensor_model.geometry", "algorithms.registration.cylinder_variance"
HAND_EYE, ODOMETRY = "algorithms.calibration.hand_eye", "algorithms.localisation.paper"
MERITS, RUN = "scenarios.equations", "run paper-robot"
CLEAN = "bench registration clean defect-30"
AS_PRINTED = "an equation"


class Entry(NamedTuple):
    """One item: its command follows `pipetwin`; `check` computes, `reads` looks into what the command wrote."""

    item: str
    what: str
    where: str
    command: str
    theirs: str
    check: Callable[[], Found] | None = None
    reads: Callable[[Path], Found] | None = None


def _eq(
    number: int, what: str, where: str, command: str, check: Callable[[], Found], theirs: str = AS_PRINTED
) -> Entry:
    return Entry(f"Eq. {number}", what, where, command, theirs, check=check)


EQUATIONS = (
    _eq(1, "points moved into the fixed frame", f"{GEOMETRY}:apply", RUN, cylinder.eq1),
    _eq(2, "rotation as turns about x, y and z", f"{VARIANCE}:_turns", CLEAN, cylinder.eq2),
    _eq(3, "translation", f"{GEOMETRY}:transform", RUN, cylinder.eq3),
    _eq(4, "a cylinder in any place", f"{VARIANCE}:_radii", CLEAN, cylinder.eq4),
    _eq(5, "its tilt: no turn about z", f"{VARIANCE}:_turns", CLEAN, cylinder.eq5),
    _eq(6, "its shift: none along z", f"{VARIANCE}:least_variance", CLEAN, cylinder.eq6),
    _eq(7, "fit by the least variance of the radii", f"{VARIANCE}:least_variance", CLEAN, cylinder.eq7),
    _eq(8, "radius of a point", f"{VARIANCE}:_radii", CLEAN, cylinder.eq8),
    _eq(9, "all radii", "algorithms.registration.from_axis:all_points_alignment", CLEAN, cylinder.eq9),
    _eq(10, "fit by the distance to the cylinder", "algorithms.registration.cylinder:align", CLEAN, cylinder.eq10),
    _eq(11, "the camera's turn carries its data", f"{HAND_EYE}:_relative", "paper fig7", attitude.eq11),
    _eq(12, "IMU data carried to the camera", f"{HAND_EYE}:_aligned", "paper fig7", attitude.eq12),
    _eq(13, "the IMU's turn in its own axes", f"{HAND_EYE}:_aligned", "paper fig7", attitude.eq12),
    _eq(14, "12 and 13 put together", f"{HAND_EYE}:_aligned", "paper fig7", attitude.eq14),
    _eq(15, "R_c by R_m and R_cal", f"{HAND_EYE}:_aligned", "paper fig7", attitude.eq14),
    _eq(16, "state of the first frame", f"{HAND_EYE}:_at", "paper fig7", attitude.eq16),
    _eq(17, "state of the second frame", f"{HAND_EYE}:_at", "paper fig7", attitude.eq16),
    _eq(18, "A X = X B as a null space", f"{HAND_EYE}:null_space", "paper fig7", attitude.eq18, "condition 2.7e16"),
    _eq(19, "turns between neighbours", f"{HAND_EYE}:_relative", "paper fig7", attitude.eq19),
    _eq(20, "turns since the first frame", f"{HAND_EYE}:_relative", "paper fig7", attitude.eq20),
    _eq(21, "the reference frame's attitude", f"{ODOMETRY}:camera_attitude", "paper fig12", attitude.eq21),
    _eq(22, "any frame's attitude", f"{ODOMETRY}:camera_attitude", "paper fig12", attitude.eq21),
    _eq(23, "roll since the reference", f"{ODOMETRY}:attitude_now", "paper fig12", attitude.eq23),
    _eq(24, "data turned back by it", f"{ODOMETRY}:attitude_now", "paper fig12", attitude.eq24),
    _eq(
        25,
        "distance by the wheels",
        "algorithms.localisation.wheels:wheel_distances_mm",
        "bench localisation",
        attitude.eq25,
    ),
    _eq(26, "distance between frames, median of three", f"{ODOMETRY}:median_step_mm", RUN, attitude.eq26),
    _eq(27, "slip as a line", "algorithms.localisation.slip:fit_line", "bench localisation", attitude.eq27),
    Entry(
        "Eq. 28",
        "closeness of the radius",
        f"{MERITS}:radius_closeness_pct",
        "paper table1",
        "0.95 % (cylinder)",
        merit.eq28,
        made.closeness,
    ),
    _eq(29, "Err of length and width", f"{MERITS}:err_pct", "paper table2", merit.eq29, "up to 5.4 %"),
    _eq(30, "Error of all three", f"{MERITS}:error_pct", "paper table2", merit.eq30, "up to 12.9 %"),
    _eq(
        31,
        "standard and expanded uncertainty",
        "scenarios.paper.table3:standard_uncertainty_mm",
        "paper table3",
        merit.eq31,
        "0.79 / 0.54 / 0.62 mm",
    ),
    _eq(
        32,
        "quality of depth",
        f"{MERITS}:depth_quality_pct",
        "paper table4",
        merit.eq32,
        "88.5 / 72.0 / 63.5 %",
    ),
)
FIGURES = (
    Entry(
        "Fig. 1",
        "sensor, slide, extracted slits, 3-D points",
        "algorithms.decode:decode",
        RUN,
        "one picture",
        reads=made.decoded(made.ROBOT),
    ),
    Entry(
        "Fig. 2",
        "two frames before and after registration",
        "algorithms.registration.cylinder_map:align",
        RUN,
        "a drawing",
        reads=made.registered,
    ),
    Entry("Fig. 3", "flow of the method", "algorithms.reconstruct:step", RUN, "a drawing", reads=made.registered),
    Entry(
        "Fig. 4",
        "triangulation in a pipe",
        "algorithms.triangulate:triangulate",
        RUN,
        "a drawing",
        reads=made.rebuilt,
    ),
    Entry(
        "Fig. 5",
        "a 10.16 mm defect set apart",
        "scenarios.paper.fig5:isolate",
        "paper fig5",
        "a picture",
        reads=made.fig5,
    ),
    Entry(
        "Fig. 6",
        "gyroscope calibration",
        f"{HAND_EYE}:calibrate_hand_eye",
        "paper fig7",
        "a drawing",
        reads=made.mount,
    ),
    Entry(
        "Fig. 7",
        "rotation by camera and by IMU",
        "scenarios.paper.fig7:run_fig7",
        "paper fig7",
        "RMSE 0.019 .. 0.022 rad",
        reads=made.fig7,
    ),
    Entry(
        "Fig. 8",
        "robot, three encoder wheels",
        "twin.robot_model:build_model",
        "view runs/paper-robot-seed0",
        "7 pulses, gear 603:1, three encoders",
        merit.fig8,
    ),
    Entry(
        "Fig. 9",
        "test pipe with two defects",
        "twin.pipe:Pipe",
        "dump-config paper-gantry",
        "2 defects of 70 x 35 x 7.5 mm, 6 inch",
        merit.fig9,
    ),
    Entry(
        "Fig. 10",
        "frames before and after the roll",
        "sensor_model.drawing:draw",
        "run paper-gantry",
        "two pictures",
        reads=made.decoded(made.GANTRY),
    ),
    Entry(
        "Fig. 11",
        "clouds by three registrations",
        "scenarios.paper.fig11:clouds",
        "paper fig11",
        "cylinder best; see Table 1",
        reads=made.fig11,
    ),
    Entry(
        "Fig. 12",
        "a roll of 8 and 25 degrees undone",
        "scenarios.paper.fig12:angle_deg",
        "paper fig12",
        "2.3 and 3.3 deg left",
        reads=made.fig12,
    ),
    Entry("Fig. 13", "the robot's pipe in 3-D", "algorithms.reconstruct:finish", RUN, "a picture", reads=made.rebuilt),
    Entry(
        "Fig. 14",
        "threshold search",
        "scenarios.oracle:oracle_err_pct",
        "paper fig14",
        "chosen by the true size",
        reads=made.fig14,
    ),
    Entry(
        "Fig. 15",
        "depth from the background",
        "algorithms.sizing.depth:floor_of",
        "paper fig15",
        "4.7 .. 9.4 mm of 7.5 mm (Table 2)",
        reads=made.fig15,
    ),
    Entry(
        "Fig. 16",
        "uncertainty over repeats",
        "scenarios.paper.fig16:fig16_rows",
        "paper fig16",
        "falls with repeats",
        merit.fig16,
    ),
    Entry(
        "Fig. 17",
        "75, 50 and 25 % wall loss",
        "scenarios.paper.fig17:make",
        "paper fig17",
        "25 % hard to tell",
        reads=made.fig17,
    ),
    Entry(
        "Fig. 18",
        "three scratches",
        "scenarios.paper.fig18:make",
        "paper fig18",
        "3 of 3 found, shape incomplete",
        reads=made.fig18,
    ),
)
TABLES = (
    Entry(
        "Table 1",
        "registration quality",
        "scenarios.paper.table1:table1",
        "paper table1",
        "cylinder 0.001, 0.025 mm2, 0.95 %",
        reads=made.table1,
    ),
    Entry(
        "Table 2",
        "one defect in six scans",
        "scenarios.paper.table2:row_of",
        "paper table2",
        "Err 5.4 %, Error 12.9 % at worst",
        reads=made.table2,
    ),
    Entry(
        "Table 3",
        "measurement uncertainty, expanded",
        "scenarios.paper.table3:table3_rows",
        "paper table3",
        "1.55 / 1.05 / 1.22 mm",
        merit.table3,
    ),
    Entry(
        "Table 4",
        "depth by wall loss",
        "scenarios.paper.table4:rows_of",
        "paper table4",
        "88.5 / 72.0 / 63.5 %",
        reads=made.table4,
    ),
)
ENTRIES = EQUATIONS + FIGURES + TABLES
