"""CAN frames of an MDF 4 file, as loggers write them (ASAM MDF 4.1, bus logging)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import from_extra
from drivers.kit.slcan_codec import FRAME_DTYPE

_FRAME, _OTHERS = "CAN_DataFrame", {"CAN_ErrorFrame": "error_frame", "CAN_RemoteFrame": "remote_frame"}
_EXTENDED = 1 << 31


def read_mdf_frames(file: Path) -> tuple[NDArray[np.void], NDArray[np.float64], dict[str, int]]:
    """Return the frames of all channels in the order of time, their times in s, (n,) each, and what was left out.

    Frames are of `drivers.kit.slcan_codec.FRAME_DTYPE`; `end_offset` is the number of the frame, from 1. Left
    out, by kind: CAN FD, error and remote frames. ConfigurationError for a damaged file and one that has none.
    """
    asammdf = from_extra("asammdf", "exchange", "reading MDF files")
    left_out: dict[str, int] = {}
    parts: list[NDArray[np.void]] = []
    times: list[NDArray[np.float64]] = []
    try:
        with file.open("rb") as stream, asammdf.MDF(stream) as mdf:
            for number, group in enumerate(mdf.groups):
                names, rows = {channel.name for channel in group.channels}, group.channel_group.cycles_nr
                for name in names & _OTHERS.keys() if rows else ():
                    left_out[_OTHERS[name]] = left_out.get(_OTHERS[name], 0) + int(rows)
                if _FRAME in names and rows:
                    signal = mdf.get(_FRAME, group=number)
                    frames, classic = _frames(signal.samples)
                    parts.append(frames)
                    times.append(np.asarray(signal.timestamps, np.float64)[classic])
                    if fd := int(len(classic) - classic.sum()):
                        left_out["fd"] = left_out.get("fd", 0) + fd
    except OSError:
        raise
    except Exception as error:  # whatever asammdf raises on a damaged file
        raise _refused(file, f"{type(error).__name__}: {error}") from error
    if not parts:
        raise _refused(file, "no CAN frames")
    times_s = np.concatenate(times)
    order = np.argsort(times_s, kind="stable")
    frames = np.concatenate(parts)[order]
    frames["end_offset"] = np.arange(1, len(frames) + 1)
    return frames, times_s[order], left_out


def _frames(samples: NDArray[Any]) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
    """Return the classic frames of a group and which of its rows they are, (rows,)."""
    has = set(samples.dtype.names or ())

    def field(name: str, default: int) -> NDArray[Any]:
        name = f"{_FRAME}.{name}"
        return samples[name] if name in has else np.full(len(samples), default)

    length, identifier = field("DataLength", 8), field("ID", 0).astype(np.uint32)
    classic = (length <= 8) & (field("EDL", 0) == 0)
    frames = np.zeros(int(classic.sum()), FRAME_DTYPE)
    frames["id"] = identifier[classic] & 0x1FFFFFFF
    frames["extended"] = ((field("IDE", 0) != 0) | (identifier & _EXTENDED != 0))[classic]
    frames["dlc"] = frames["length"] = length[classic]
    data = samples[f"{_FRAME}.DataBytes"][classic][:, :8]
    frames["data"][:, : data.shape[1]] = data
    frames["data"][np.arange(8) >= frames["length"][:, None]] = 0
    return frames, classic


def _refused(file: Path, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the capture cannot be read",
        where=str(file),
        found=found,
        expected="an MDF 4 file with logged CAN frames (CAN_DataFrame)",
        remedy="`gyrobench look` reads an MDF file of decoded signals",
    )
