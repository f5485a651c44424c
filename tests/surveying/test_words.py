"""Roles of signals, against DBC files that other people wrote: of opendbc, read by hand, and of our own profiles."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.places import DBC

from echogrid.can import dbc_file
from echogrid.can.database import Database
from echogrid.can.profile import load_radar
from echogrid.surveying.drafts import motion_signals
from echogrid.surveying.groups import groups_of
from echogrid.surveying.words import corner_of, unit_of

opendbc = pytest.importorskip("opendbc", reason="opendbc, whose DBC files this reads, refuses Python 3.13")
OPENDBC = Path(opendbc.DBC_PATH)


def database(name: str) -> Database:
    path = DBC / f"{name}.dbc"
    path = path if path.is_file() else OPENDBC / f"{name}.dbc"
    if path.is_file():
        return dbc_file.parse(path.read_bytes())
    return dbc_file.parse(opendbc.get_generated_dbcs()[name].encode())


@pytest.mark.parametrize(
    ("profile", "name"),
    [
        ("corner_radar", "corner_radar"),
        ("corner_radar_classic", "corner_radar_classic"),
        ("ars408", "ars408"),
        ("srr520", "srr520"),
        ("ford_mrr", "FORD_CADS"),
        ("mando_corner", "hyundai_kia_mando_corner_radar_generated"),
        ("toyota_tss_p", "toyota_adas"),
    ],
)
def test_detections_are_found_as_the_profiles_written_by_hand_have_them(profile: str, name: str) -> None:
    wanted = load_radar(DBC / f"{profile}.toml").detections
    group = groups_of(database(name))[0]
    assert (group.name, group.n, group.per_frame, group.first_k) == (wanted.messages, wanted.n, wanted.per_frame, wanted.first_k)
    roles = ("range", "azimuth", "range_rate", "x", "y", "vx", "vy")
    assert {role: q.signal for role in roles if (q := getattr(wanted, role)) is not None} == {
        role: signal for role, signal in group.roles.items() if role in roles
    }
    if wanted.valid is not None:
        assert group.roles["valid"] == wanted.valid.signal
    for role in roles:
        if role in group.roles and (unit := unit_of(group.signal(role))) is not None:
            assert unit == getattr(wanted, role).unit


# Message, rear left, rear right; message, yaw rate: as an engineer reads these files.
MOTION = {
    "vehicle_motion": ("WheelSpeedsRear", "WheelSpeedRL", "WheelSpeedRR", "YawRate", "YawRate"),
    "fca_giorgio": ("ABS_1", "WHEEL_SPEED_RL", "WHEEL_SPEED_RR", "ABS_2", "YAW_RATE"),
    "ford_lincoln_base_pt": ("WheelSpeed", "WhlRl_W_Meas", "WhlRr_W_Meas", "Yaw_Data_FD1", "VehYaw_W_Actl"),
    "ford_fusion_2018_pt": ("WheelSpeed_CG1", "WhlRl_W_Meas", "WhlRr_W_Meas", "Yaw_Data", "VehYaw_W_Actl"),
    "hyundai_2015_ccan": ("WHL_SPD11", "WHL_SPD_RL", "WHL_SPD_RR", "ESP12", "YAW_RATE"),
    "rivian_primary_actuator": (
        *("ESP_WSpeed_Rear", "ESP_Wheel_Speed_Left_Rear", "ESP_Wheel_Speed_Right_Rear"),
        *("RCM_IMU_LatAccYaw", "RCM_IMU_Yaw"),
    ),
    "toyota_nodsu_pt_generated": ("WHEEL_SPEEDS", "WHEEL_SPEED_RL", "WHEEL_SPEED_RR", "KINEMATICS", "YAW_RATE"),
    "vw_mqb": ("ESP_19", "ESP_HL_Radgeschw_02", "ESP_HR_Radgeschw_02", "ESP_02", "ESP_Gierrate"),
    "vw_mlb": ("ESP_03", "ESP_HL_Radgeschw", "ESP_HR_Radgeschw", "ESP_02", "ESP_Gierrate"),
    "cadillac_ct6_powertrain": ("EBCMWheelSpdRear", "RLWheelSpd", "RRWheelSpd", "EBCMVehicleDynamic", "YawRate"),
}


@pytest.mark.parametrize("name", MOTION)
def test_ego_motion_is_found_as_an_engineer_reads_the_file(name: str) -> None:
    best = motion_signals(database(name))[0]
    assert (best.wheels.name, best.rear[0].name, best.rear[1].name, best.turning.name, best.yaw_rate.name) == MOTION[name]


@pytest.mark.parametrize(
    ("name", "corner"),
    [
        ("SRR_FL_Status", "front_left"),
        ("RadarRearRightHeader", "rear_right"),
        ("CornerRadar_hinten_links", "rear_left"),
        ("RDR_HR_Obj", "rear_right"),
        ("vWhlRrL", "rear_left"),
        ("vWhlFrR", "front_right"),
        ("wheelSpeedReR", "rear_right"),
        ("Left_Front_SRR", "front_left"),
        ("Radar1_Header", None),
        ("RadarPoint", None),
    ],
)
def test_corners_are_read_off_names(name: str, corner: str | None) -> None:
    assert corner_of(name) == corner


def test_a_car_without_radars_has_no_group() -> None:
    """Of the files that hold no radar at all, none gives a message with numbered detections."""
    for name in ("vehicle_motion", "ford_fusion_2018_pt", "vw_mqb", "hyundai_2015_ccan"):
        assert not [group for group in groups_of(database(name)) if group.n is not None or group.per_frame > 1], name


@pytest.mark.parametrize(("message", "found"), [("WHEEL_SPEEDS", True), ("WheelSpd1", True), ("DOORS", False), ("RADARS", False)])
def test_a_message_of_the_wheels_may_call_them_by_their_corners_alone(message: str, found: bool) -> None:
    """As Mazda's does; the yaw rate lies under two selectors."""
    corners = "".join(f' SG_ {name} : {16 * n}|16@1+ (0.01,-100) [0|555] "kph" X\n' for n, name in enumerate(("FL", "FR", "RL", "RR")))
    imu = ' SG_ Page M : 0|4@1+ (1,0) [0|15] "" X\n SG_ Sub m1M : 4|4@1+ (1,0) [0|15] "" X\n'
    imu += ' SG_ Yaw_Rate m2 : 8|16@1- (0.01,0) [-9|9] "deg/s" X\n'
    text = f'VERSION ""\nBU_: X\nBO_ 256 {message}: 8 X\n{corners}\nBO_ 258 Imu: 8 X\n{imu}\n'
    read = dbc_file.parse(f"{text}SG_MUL_VAL_ 258 Sub Page 1-1;\nSG_MUL_VAL_ 258 Yaw_Rate Sub 2-2;\n".encode())
    told = [(one.wheels.name, *(signal.name for signal in one.rear), one.yaw_rate.name) for one in motion_signals(read)]
    assert told == ([(message, "RL", "RR", "Yaw_Rate")] if found else [])
