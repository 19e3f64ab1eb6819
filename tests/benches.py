"""Bench files that several tests use: a table and a chamber, a FOG on a serial port, a MEMS unit on CAN."""

BENCH = """
[bench]
name = "test bench"
latitude_deg = 39.10
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB2"
auxiliary = { 1 = "case" }
"""
FOG = """
[[gyro]]
name = "fog_1"
driver = "kvh1750"
port = "/dev/ttyUSB1"
rate_hz = 100
axis = "x"
unit = "FOG-001"
case_sensor = 1
"""
CAN_GYRO = """
[[gyro]]
name = "can_1"
driver = "sbg_ellipse"
interface = "gyrobench_slcan"
channel = "/dev/ttyACM0"
rate_hz = 100
axes = "xyz"
axis = "z"
unit = "ELL-001"
"""
FOG_BENCH = BENCH + FOG
