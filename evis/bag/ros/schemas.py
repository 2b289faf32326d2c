"""Holds the ROS 2 definitions of the recorded messages, as MCAP's `ros2msg` wants them: dependencies follow the
message."""

from __future__ import annotations

_SEPARATOR = "=" * 80

_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
_TIME = "int32 sec\nuint32 nanosec\n"
_VECTOR3 = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_STAMPED = {"std_msgs/Header": _HEADER, "builtin_interfaces/Time": _TIME}


def _definition(text: str, parts: dict[str, str]) -> str:
    return text + "".join(f"{_SEPARATOR}\nMSG: {name}\n{part}" for name, part in parts.items())


IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
IMU = "sensor_msgs/msg/Imu"
TF = "tf2_msgs/msg/TFMessage"
EVENT_PACKET = "event_camera_msgs/msg/EventPacket"

TEXT = "std_msgs/msg/String"

DEFINITIONS: dict[str, str] = {
    TEXT: "string data\n",
    IMAGE: _definition(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        "uint8[] data\n",
        _STAMPED,
    ),
    CAMERA_INFO: _definition(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
        {
            **_STAMPED,
            "sensor_msgs/RegionOfInterest": "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\n"
            "bool do_rectify\n",
        },
    ),
    IMU: _definition(
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        {**_STAMPED, "geometry_msgs/Quaternion": _QUATERNION, "geometry_msgs/Vector3": _VECTOR3},
    ),
    TF: _definition(
        "geometry_msgs/TransformStamped[] transforms\n",
        {
            "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
            "geometry_msgs/Transform transform\n",
            **_STAMPED,
            "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
            "geometry_msgs/Vector3": _VECTOR3,
            "geometry_msgs/Quaternion": _QUATERNION,
        },
    ),
    EVENT_PACKET: _definition(
        "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
        "bool is_bigendian\nuint8[] events\n",
        _STAMPED,
    ),
}
"""ROS type -> its definition."""
