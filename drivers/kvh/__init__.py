"""KVH DSP-1750, DSP-1760 and 1775 fibre-optic gyros on RS-422: codec and driver."""

from drivers.kvh._driver import Kvh1750, KvhConfig
from drivers.kvh.format import KvhDecoder, encode_bit, encode_frames, rate_dps

__all__ = ["Kvh1750", "KvhConfig", "KvhDecoder", "encode_bit", "encode_frames", "rate_dps"]
