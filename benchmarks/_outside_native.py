"""Decoders in C++ that others wrote, compiled with g++ where it is there, on the bytes of emulated units.

A few lines around each read a file, give the decoder its bytes and print what it found: force in g, rate in
deg/s, temperature in degC. What the decoders include of their own frameworks and is no part of the decoding (a
serial port, a log, a CRC by its polynomial) is made here.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

_READ = """
#include <cstdio>
#include <cstdint>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>
static std::vector<uint8_t> all(const char* name) {
  std::vector<uint8_t> data(1 << 22);
  FILE* file = fopen(name, "rb");
  data.resize(fread(data.data(), 1, data.size(), file));
  return data;
}
static void print(double fx, double fy, double fz, double wx, double wy, double wz, double t) {
  printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g\\n", fx, fy, fz, wx, wy, wz, t);
}
static const double G = 9.80665, DEG = 180.0 / M_PI;
"""
_HG4930_CORE = """
#pragma once
#include <cmath>
#include <cstdint>
#include <vector>
struct HardwareSerial {
  std::vector<uint8_t> data;
  size_t at = 0;
  void begin(int32_t) {}
  bool available() const { return at < data.size(); }
  uint8_t read() { return data[at++]; }
};
"""
_HG4930 = (
    _READ
    + """
#define private public
#include "hg4930.h"
int main(int, char** names) {
  HardwareSerial port;
  port.data = all(names[1]);
  bfs::Hg4930 imu(&port);
  imu.Begin();
  // back from the axes of an aircraft that this library turns to, to those of the unit
  while (port.available())
    if (imu.Parse())
      print(-imu.accel_x_mps2() / G, imu.accel_y_mps2() / G, -imu.accel_z_mps2() / G, -imu.gyro_x_radps() * DEG,
            imu.gyro_y_radps() * DEG, -imu.gyro_z_radps() * DEG, imu.die_temp_c());
}
"""
)
_VECTORNAV = (
    _READ
    + """
#include "vn/compositedata.h"
#include "vn/packet.h"
#include "vn/packetfinder.h"
using namespace vn::protocol::uart;
static void found(void*, Packet& packet, size_t, vn::xplat::TimeStamp) {
  if (packet.type() != Packet::TYPE_BINARY || !packet.isValid()) return;
  vn::sensors::CompositeData data = vn::sensors::CompositeData::parse(packet);
  auto force = data.acceleration();
  auto rate = data.angularRate();
  print(force.x / G, force.y / G, force.z / G, rate.x * DEG, rate.y * DEG, rate.z * DEG,
        data.hasTemperature() ? data.temperature() : NAN);
}
int main(int, char** names) {
  std::vector<uint8_t> data = all(names[1]);
  PacketFinder finder;
  finder.registerPossiblePacketFoundHandler(nullptr, found);
  for (size_t at = 0; at < data.size(); at += 100)
    finder.processReceivedData(reinterpret_cast<char*>(&data[at]), std::min<size_t>(100, data.size() - at));
}
"""
)
_KVH_BASE = """
#pragma once
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>
#define LOG_WARN(...)
namespace base {
struct Time { static Time now() { return Time(); } };
template <typename T> T unset() { return NAN; }
namespace samples { struct IMUSensors { Time time; double acc[3], gyro[3], mag[3]; }; }
}
namespace boost {
template <int, uint32_t polynomial, uint32_t first, uint32_t last, bool, bool> struct crc_optimal {
  uint32_t value = first;
  void process_bytes(const void* data, size_t count) {
    for (size_t i = 0; i < count; ++i) {
      value ^= uint32_t(static_cast<const uint8_t*>(data)[i]) << 24;
      for (int bit = 0; bit < 8; ++bit) value = value << 1 ^ (value >> 31 ? polynomial : 0);
    }
  }
  uint32_t checksum() const { return value ^ last; }
};
}
namespace iodrivers_base {
struct Driver {
  std::vector<uint8_t> data;
  size_t at = 0;
  explicit Driver(int) {}
  virtual ~Driver() {}
  virtual int extractPacket(uint8_t const*, size_t) const = 0;
  void openURI(std::string const&) {}
  int readPacket(uint8_t* packet, size_t) {
    while (at < data.size()) {
      int size = extractPacket(&data[at], data.size() - at);
      if (size == 0) break;
      at += std::abs(size);
      if (size < 0) continue;
      memcpy(packet, &data[at - size], size);
      return size;
    }
    throw 0;
  }
};
}
"""
_KVH = (
    _READ
    + """
#include <imu_kvh_1750/Driver.hpp>
int main(int, char** names) {
  imu_kvh_1750::Driver imu;
  imu.data = all(names[1]);
  try {
    for (;;) {
      imu.read();
      auto one = imu.getIMUReading();
      // turned by so many radians in a sample
      double rate = DEG * 100.0;
      print(one.acc[0], one.acc[1], one.acc[2], one.gyro[0] * rate, one.gyro[1] * rate, one.gyro[2] * rate,
            imu.getTemperature());
    }
  } catch (int) {}
}
"""
)
Message = tuple[tuple[float, ...], tuple[float, ...], float]
"""Force in g, rate in deg/s, temperature in degC; NaN where the message has none."""


class NativeDecoders:
    """The decoders in `sources`, built in `folder`."""

    def __init__(self, sources: Path, folder: Path) -> None:
        self._sources, self._folder = sources, folder

    def hg4930(self, data: bytes) -> list[Message]:
        """Return what bolderflight/hg4930 finds."""
        room = self._room("hg4930", {"core/core.h": _HG4930_CORE, "main.cpp": _HG4930})
        source = self._sources / "hg4930/src"
        return self._run(room, [source / "hg4930.cpp"], [room, source], data)

    def vectornav(self, data: bytes) -> list[Message]:
        """Return what vnproglib, VectorNav's own library, finds."""
        room = self._room("vectornav", {"main.cpp": _VECTORNAV})
        source = next(self._sources.glob("vectornav/vnproglib-*/cpp"))
        files = [path for path in sorted((source / "src").glob("*.cpp")) if path.name != "benchmark.cpp"]
        return self._run(room, files, [source / "include"], data)

    def kvh(self, data: bytes) -> list[Message]:
        """Return what drivers-imu_kvh_1750 finds of messages in Format A at 100 Hz."""
        source = self._sources / "drivers-imu_kvh_1750/src"
        headers = (
            "iodrivers_base/Driver",
            "base/samples/IMUSensors",
            "boost/crc",
            "base-logging/Logging",
            "base/Float",
        )
        stubs = {f"{name}.hpp": "#pragma once\n#include <kvh_base.h>\n" for name in headers}
        files = stubs | {"kvh_base.h": _KVH_BASE, "main.cpp": _KVH}
        files["imu_kvh_1750/Driver.hpp"] = (source / "Driver.hpp").read_text(encoding="utf-8")
        room = self._room("kvh", files)
        return self._run(room, [source / "Driver.cpp"], [room], data)

    def _room(self, name: str, files: dict[str, str]) -> Path:
        room = self._folder / name
        for path, text in files.items():
            (room / path).parent.mkdir(parents=True, exist_ok=True)
            (room / path).write_text(text, encoding="utf-8")
        return room

    def _run(self, room: Path, files: list[Path], include: list[Path], data: bytes) -> list[Message]:
        (room / "bytes").write_bytes(data)
        paths = [f"-I{path}" for path in include]
        build = [
            "g++",
            "-std=c++14",
            "-O1",
            "-w",
            *paths,
            "-o",
            "decoder",
            "main.cpp",
            *map(str, files),
            "-lpthread",
        ]
        subprocess.run(build, check=True, cwd=room)
        found = subprocess.run(
            [room / "decoder", "bytes"], check=True, cwd=room, capture_output=True, text=True
        )
        return list(_messages(found.stdout))


def _messages(text: str) -> Iterator[Message]:
    for line in text.splitlines():
        numbers = tuple(map(float, line.split()))
        yield numbers[:3], numbers[3:6], numbers[6]
