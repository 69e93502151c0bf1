"""Starts `gripline run` with its ROS 2 side: `ros2 launch gripline_msgs gripline.launch.py name:=cell_3/left control:=true`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

ARGUMENTS = [
    ("program", "gripline", "the program, built with --features ros2"),
    ("name", "gripline", "namespace of topics and services"),
    ("source", "sim", "where pictures come from, as `gripline run --source`"),
    ("mcu", "embedded", "which microcontroller, as `gripline run --mcu`"),
    ("range", "localhost", "localhost, or subnet for other machines too"),
    ("rmw", "fastrtps", "how services travel: fastrtps or cyclonedds, as RMW_IMPLEMENTATION of the clients"),
    ("control", "false", "true: offer the services that move the gripper"),
    ("config", "", "configuration file; empty: the usual one"),
]


def start(context):
    """The process; a function because switches are there or not."""
    value = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    command = [value["program"], "run", "--source", value["source"], "--mcu", value["mcu"]]
    command += ["--ros2-name", value["name"], "--ros2-range", value["range"], "--ros2-rmw", value["rmw"]]
    if value["control"] == "true":
        command += ["--ros2-control"]
    if value["config"]:
        command += ["--config", value["config"]]
    return [ExecuteProcess(cmd=command, output="screen", sigterm_timeout="10")]


def generate_launch_description():
    """What `ros2 launch` asks for."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text) for name, default, text in ARGUMENTS
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
