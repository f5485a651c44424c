"""The definitions of the ROS messages that recordings and viewers get along with the bytes, in ROS 2's .msg language."""

from __future__ import annotations

import re

CAN_FRAME = "echogrid_msgs/msg/CanFrame"
_RULE = "=" * 80

_FIELDS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/MapMetaData": (
        "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin"
    ),
    "nav_msgs/OccupancyGrid": "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "map_msgs/OccupancyGridUpdate": "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data",
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\n"
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
    "sensor_msgs/PointField": (
        "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n"
        "string name\nuint32 offset\nuint8 datatype\nuint32 count"
    ),
    "sensor_msgs/PointCloud2": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
        "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense"
    ),
    # Ours, for no common one holds all that python-can's Message does: ros2_socketcan's FdFrame knows no bit rate switch and no remote
    # frame, and does not say whether a short frame was CAN FD. Whole nanoseconds would not give a log's time back to the bit.
    "echogrid_msgs/CanFrame": (
        "std_msgs/Header header\nfloat64 timestamp\nuint32 id\n"
        "bool is_extended\nbool is_remote\nbool is_error\nbool is_fd\nbool bitrate_switch\nbool error_state\nbool is_rx\n"
        "uint8 len\nuint8[] data"
    ),
}


def definition(kind: str) -> str:
    """The definition of a message such as "nav_msgs/msg/OccupancyGrid" and behind it those of all that it holds ("ros2msg").

    Raises KeyError for one that we neither send nor need.
    """
    wanted = [kind.replace("/msg/", "/")]
    for name in wanted:  # which grows meanwhile
        for inner in re.findall(r"^(\w+/\w+)", _FIELDS[name], re.MULTILINE):
            if inner not in wanted:
                wanted.append(inner)
    first, *rest = wanted
    return "\n".join((_FIELDS[first], *(f"{_RULE}\nMSG: {name}\n{_FIELDS[name]}" for name in rest))) + "\n"
